//! Looks up groups by name, and users by number.

use nix::unistd::{Group, Uid, User};

/// Returns the number of the group `name`, or `None` if this machine has no such group. It uses the name service
/// (getgrnam_r(3)).
pub fn group_id(name: &str) -> Option<u32> {
    Group::from_name(name).ok().flatten().map(|group| group.gid.as_raw())
}

/// Returns the name and number of the user `uid`, or its number alone if this machine knows no name. It uses the
/// name service (getpwuid_r(3)).
pub fn user_name(uid: u32) -> String {
    let user = User::from_uid(Uid::from_raw(uid)).ok().flatten();
    user.map_or_else(|| uid.to_string(), |user| format!("{} ({uid})", user.name))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn user_without_name_is_shown_by_number() {
        assert_eq!(user_name(0), "root (0)");
        assert_eq!(user_name(4_242_424), "4242424");
    }

    #[test]
    fn group_lookup_finds_root_and_no_invalid_name() {
        assert_eq!(group_id("root"), Some(0));
        assert_eq!(group_id("no-such-group-here"), None);
        assert_eq!(group_id("nul\0inside"), None);
    }
}
