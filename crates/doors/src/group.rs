//! Groups by name.

use nix::unistd::Group;

/// The number of the group `name`; nothing if this machine has no such group. Asks the name service (getgrnam_r(3)).
pub fn group_id(name: &str) -> Option<u32> {
    Group::from_name(name).ok().flatten().map(|group| group.gid.as_raw())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn root_is_everywhere_and_nonsense_nowhere() {
        assert_eq!(group_id("root"), Some(0));
        assert_eq!(group_id("no-such-group-here"), None);
        assert_eq!(group_id("nul\0inside"), None);
    }
}
