//! The instance's folder, its shared memory, and the process that holds it.

use super::facts::PlaceFacts;
use crate::cli::InstanceArgs;
use instance::Instance;
use rustix::fs::{Access, AtFlags, CWD, accessat};
use std::os::unix::fs::MetadataExt;
use std::path::Path;
use std::time::{Duration, Instant};

/// Ending of the one page that each domain of iceoryx2 has. The first node makes it. No node holds it, and the
/// next one reuses it.
const BOOKKEEPING: &str = ".global_mgmt";

/// Common prefix of the names of all instances.
const INSTANCES: &str = "teleop_";

/// Longest time for a scan of all processes. Assumption: a thousand processes took 0.1 s.
const LOOK_WITHIN: Duration = Duration::from_secs(5);

#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Folder {
    /// Nothing is there. `can_be_made` is true if the nearest existing folder permits its creation.
    Missing { can_be_made: bool },
    /// Another kind of file, or one that cannot be examined.
    Other(String),
    /// A folder.
    Is { uid: u32, mode: u32, usable: bool },
}

/// A piece of shared memory of this instance.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Segment {
    pub name: String,
    pub bytes: u64,
    /// True if a living process has it mapped, as far as this user can see.
    pub in_use: bool,
}

pub fn read(place: &InstanceArgs) -> PlaceFacts {
    let instance = Instance::unmade(&place.run_dir);
    let domains = [instance.core_domain(), instance.input_domain()];
    let roots = domains.iter().map(|domain| domain.root.clone());
    let (segments, strangers) = segments(&domains.each_ref().map(|domain| domain.prefix.as_str()));
    let paths = std::iter::once(instance.run_dir().to_path_buf()).chain(roots);
    PlaceFacts {
        run_dir: instance.run_dir().to_path_buf(),
        folders: paths.map(|path| (path.clone(), folder(&path))).collect(),
        refused: domains.iter().find_map(|domain| domain.check().err()).map(|error| error.to_string()),
        segments,
        strangers,
        holder: holder(&instance.operator_lock()),
    }
}

fn folder(path: &Path) -> Folder {
    let usable = |path: &Path| {
        accessat(CWD, path, Access::READ_OK | Access::WRITE_OK | Access::EXEC_OK, AtFlags::EACCESS).is_ok()
    };
    match std::fs::metadata(path) {
        Ok(found) if found.is_dir() => {
            Folder::Is { uid: found.uid(), mode: found.mode() & 0o7777, usable: usable(path) }
        }
        Ok(_) => Folder::Other(String::from("not a folder")),
        Err(_) if path.is_symlink() => Folder::Other(String::from("a dangling link")),
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => {
            let nearest = path.ancestors().skip(1).find(|folder| folder.exists());
            Folder::Missing { can_be_made: nearest.is_some_and(usable) }
        }
        Err(error) => Folder::Other(error.to_string()),
    }
}

/// Returns the segments of this instance, and those of this user's other instances that no process has mapped.
fn segments(prefixes: &[&str]) -> (Vec<Segment>, Vec<Segment>) {
    let own_uid = rustix::process::geteuid().as_raw();
    let mapped = bus::Mapped::read(INSTANCES, Instant::now() + LOOK_WITHIN);
    let (mut own, mut dead) = (Vec::new(), Vec::new());
    for bus::Segment { name, bytes, uid } in bus::segments_beginning(INSTANCES) {
        let Some(prefix) = bus::prefix_of(&name).map(str::to_owned) else { continue };
        // The mappings of another user's processes are visible to root only.
        let hidden = own_uid != 0 && uid != own_uid;
        if !prefixes.contains(&prefix.as_str()) {
            if uid == own_uid && mapped.as_ref().is_some_and(|mapped| !mapped.any_of(&prefix)) {
                dead.push(Segment { name, bytes, in_use: false });
            }
        } else if !name.ends_with(BOOKKEEPING) {
            let in_use = hidden || mapped.as_ref().is_none_or(|mapped| mapped.has(&name));
            own.push(Segment { name, bytes, in_use });
        }
    }
    (own, dead)
}

/// Returns the process that holds the lock file, read from /proc/locks. Trying to take the lock would disturb a
/// process that starts now.
pub fn holder(lock: &Path) -> Option<u32> {
    let inode = std::fs::metadata(lock).ok()?.ino();
    let locks = std::fs::read_to_string("/proc/locks").ok()?;
    holders(&locks, inode).into_iter().find(|pid| {
        let open = std::fs::read_dir(format!("/proc/{pid}/fd")).into_iter().flatten().flatten();
        let mut open = open.filter_map(|entry| std::fs::read_link(entry.path()).ok());
        open.any(|target| target == lock)
    })
}

/// Returns the processes that hold a flock on a file with this inode, on any device. A line reads `1: FLOCK
/// ADVISORY WRITE 812 00:1a:77 0 EOF`.
fn holders(locks: &str, inode: u64) -> Vec<u32> {
    let holder = |line: &str| {
        let words: Vec<_> = line.split_whitespace().collect();
        let [_, "FLOCK", _, "WRITE", pid, file, ..] = words.as_slice() else { return None };
        let of_file = file.rsplit(':').next()?.parse::<u64>().ok()?;
        (of_file == inode).then(|| pid.parse().ok()).flatten()
    };
    locks.lines().filter_map(holder).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lock_holder_is_found_by_inode() {
        let locks = "1: FLOCK  ADVISORY  WRITE 812 00:1a:77 0 EOF\n2: POSIX  ADVISORY  WRITE 5 08:01:77 0 EOF\n\
                     3: -> FLOCK  ADVISORY  WRITE 9 00:1a:77 0 EOF\n4: FLOCK  ADVISORY  WRITE 13 00:1a:770 0 EOF\n";
        assert_eq!(holders(locks, 77), [812]);
        assert_eq!(holders(locks, 7), Vec::<u32>::new());
        assert_eq!(holders("", 77), Vec::<u32>::new());
    }
}
