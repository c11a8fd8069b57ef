//! The instance's folder, its shared memory, and who holds it.

use super::facts::PlaceFacts;
use crate::cli::Place;
use pipeline::Instance;
use rustix::fs::{Access, AtFlags, CWD, accessat};
use std::collections::BTreeSet;
use std::os::unix::fs::MetadataExt;
use std::path::Path;

/// Ending of the one page that each domain of iceoryx2 has: made by its first node, kept by none, there for the next.
const BOOKKEEPING: &str = ".global_mgmt";

/// Unit of `st_blocks` (stat(2)).
const BLOCK_BYTES: u64 = 512;

/// What is at a path.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Folder {
    /// Nothing; whether it can be made in the nearest folder that exists.
    Missing { can_be_made: bool },
    /// Something else, or something that cannot be examined.
    Other(String),
    /// A folder.
    Is { uid: u32, mode: u32, usable: bool },
}

/// A piece of shared memory of this instance.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Segment {
    pub name: String,
    pub bytes: u64,
    /// Whether a living process has it mapped, as far as this user may see.
    pub in_use: bool,
}

pub fn read(place: &Place) -> PlaceFacts {
    let instance = Instance::unmade(&place.run_dir);
    let domains = [instance.core_domain(), instance.input_domain()];
    let roots = domains.iter().map(|domain| domain.root.clone());
    let paths = std::iter::once(instance.run_dir().to_path_buf()).chain(roots);
    PlaceFacts {
        run_dir: instance.run_dir().to_path_buf(),
        folders: paths.map(|path| (path.clone(), folder(&path))).collect(),
        refused: domains.iter().find_map(|domain| domain.check().err()).map(|error| error.to_string()),
        segments: segments(&domains.each_ref().map(|domain| domain.prefix.as_str())),
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
        Err(_) if path.is_symlink() => Folder::Other(String::from("a link that leads nowhere")),
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => {
            let nearest = path.ancestors().skip(1).find(|folder| folder.exists());
            Folder::Missing { can_be_made: nearest.is_some_and(usable) }
        }
        Err(error) => Folder::Other(error.to_string()),
    }
}

fn segments(prefixes: &[&str]) -> Vec<Segment> {
    let (mapped, own_uid) = (mapped(prefixes), rustix::process::geteuid().as_raw());
    let mut found = Vec::new();
    for entry in std::fs::read_dir("/dev/shm").into_iter().flatten().flatten() {
        let name = entry.file_name().to_string_lossy().into_owned();
        if prefixes.iter().any(|prefix| name.starts_with(prefix)) && !name.ends_with(BOOKKEEPING) {
            let Ok(metadata) = entry.metadata() else { continue };
            // What another user has mapped is hidden from all but root.
            let hidden = own_uid != 0 && metadata.uid() != own_uid;
            let (in_use, bytes) = (hidden || mapped.contains(&name), metadata.blocks() * BLOCK_BYTES);
            found.push(Segment { in_use, name, bytes });
        }
    }
    found.sort_by(|a, b| a.name.cmp(&b.name));
    found
}

/// Names in /dev/shm with one of these prefixes that some process has mapped.
fn mapped(prefixes: &[&str]) -> BTreeSet<String> {
    let mut names = BTreeSet::new();
    for process in std::fs::read_dir("/proc").into_iter().flatten().flatten() {
        let is_process = process.file_name().to_string_lossy().bytes().all(|byte| byte.is_ascii_digit());
        let maps = if is_process { std::fs::read_to_string(process.path().join("maps")).ok() } else { None };
        for line in maps.iter().flat_map(|maps| maps.lines()) {
            let name = line.split_once("/dev/shm/").map(|(_, name)| name);
            if let Some(name) = name.filter(|name| prefixes.iter().any(|prefix| name.starts_with(prefix))) {
                names.insert(name.to_owned());
            }
        }
    }
    names
}

/// The process that holds the lock file, from /proc/locks: taking the lock to try would disturb who starts now.
pub fn holder(lock: &Path) -> Option<u32> {
    let inode = std::fs::metadata(lock).ok()?.ino();
    let locks = std::fs::read_to_string("/proc/locks").ok()?;
    holders(&locks, inode).into_iter().find(|pid| {
        let open = std::fs::read_dir(format!("/proc/{pid}/fd")).into_iter().flatten().flatten();
        let mut open = open.filter_map(|entry| std::fs::read_link(entry.path()).ok());
        open.any(|target| target == lock)
    })
}

/// Processes that hold a flock on a file with this inode, of whatever device; as `1: FLOCK ADVISORY WRITE 812 00:1a:77 0 EOF`.
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
    fn the_holder_is_found_by_its_file() {
        let locks = "1: FLOCK  ADVISORY  WRITE 812 00:1a:77 0 EOF\n2: POSIX  ADVISORY  WRITE 5 08:01:77 0 EOF\n\
                     3: -> FLOCK  ADVISORY  WRITE 9 00:1a:77 0 EOF\n4: FLOCK  ADVISORY  WRITE 13 00:1a:770 0 EOF\n";
        assert_eq!(holders(locks, 77), [812]);
        assert_eq!(holders(locks, 7), Vec::<u32>::new());
        assert_eq!(holders("", 77), Vec::<u32>::new());
    }
}
