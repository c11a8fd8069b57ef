//! The shared-memory filesystem: its free space, and the segments in it.

use crate::error::BusError;
use std::collections::BTreeSet;
use std::os::unix::fs::{MetadataExt, PermissionsExt};
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Folder of POSIX shared memory on Linux (shm_overview(7)).
const SHARED_MEMORY: &str = "/dev/shm";
/// Memory that one domain may need. 8 clients with 20 readers took 1.0 MiB (2026-11). 16 times that leaves room
/// for restarts, because the memory of dead processes stays until it is cleaned up.
pub const SHARED_MEMORY_NEEDED_BYTES: u64 = 16 << 20;

/// Digits of the hash that follows the prefix in every name (iceoryx2 0.10.0: SHA-1 of the kind of segment).
const HASH_DIGITS: usize = 40;
/// Unit of `st_blocks` (stat(2)).
const BLOCK_BYTES: u64 = 512;

/// A shared-memory segment.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Segment {
    /// Name in /dev/shm.
    pub name: String,
    /// Memory that it takes.
    pub bytes: u64,
    /// Its owner.
    pub uid: u32,
}

impl Segment {
    /// Returns its path.
    pub fn path(&self) -> PathBuf {
        Path::new(SHARED_MEMORY).join(&self.name)
    }
}

/// Returns the segments in /dev/shm of the domains whose prefix satisfies `is_prefix`, sorted by name.
fn segments_of(is_prefix: impl Fn(&str) -> bool) -> Vec<Segment> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(SHARED_MEMORY).into_iter().flatten().flatten() {
        let Ok(name) = entry.file_name().into_string() else { continue };
        let Ok(metadata) = entry.metadata() else { continue };
        if metadata.is_file() && prefix_of(&name).is_some_and(&is_prefix) {
            found.push(Segment { name, bytes: metadata.blocks() * BLOCK_BYTES, uid: metadata.uid() });
        }
    }
    found.sort_by(|a, b| a.name.cmp(&b.name));
    found
}

/// Returns the segments in /dev/shm of the domain with exactly this prefix, sorted by name.
pub fn segments(prefix: &str) -> Vec<Segment> {
    segments_of(|found| found == prefix)
}

/// Returns the segments in /dev/shm of all domains whose prefix begins with `prefix`, sorted by name.
pub fn segments_beginning(prefix: &str) -> Vec<Segment> {
    segments_of(|found| found.starts_with(prefix))
}

/// Returns the prefix of the domain that a name in /dev/shm belongs to. Returns `None` if the transport makes no
/// such names.
pub fn prefix_of(name: &str) -> Option<&str> {
    let digits = |text: &str| text.len() == HASH_DIGITS && text.bytes().all(|byte| byte.is_ascii_hexdigit());
    let ends = name.match_indices('_').map(|(end, _)| end).filter(|&end| end >= HASH_DIGITS);
    let mut starts = ends.map(|end| (end - HASH_DIGITS, end));
    let (start, _) = starts.find(|&(start, end)| name.get(start..end).is_some_and(digits))?;
    name.get(..start)
}

/// Names in /dev/shm that some process has mapped, as far as this user may see.
#[derive(Clone, Debug)]
pub struct Mapped(BTreeSet<String>);

impl Mapped {
    /// Searches /proc for names that begin with `prefix`. Returns `None` if the search is not finished at `give_up`.
    pub fn read(prefix: &str, give_up: Instant) -> Option<Self> {
        let mut names = BTreeSet::new();
        for process in std::fs::read_dir("/proc").into_iter().flatten().flatten() {
            if Instant::now() >= give_up {
                return None;
            }
            let is_process = process.file_name().as_encoded_bytes().iter().all(u8::is_ascii_digit);
            let maps = if is_process { std::fs::read_to_string(process.path().join("maps")).ok() } else { None };
            for line in maps.iter().flat_map(|maps| maps.lines()) {
                let name = line.split_once("/dev/shm/").map(|(_, name)| name);
                names.extend(name.filter(|name| name.starts_with(prefix)).map(str::to_owned));
            }
        }
        Some(Self(names))
    }

    /// Returns true if `name` is among them.
    pub fn has(&self, name: &str) -> bool {
        self.0.contains(name)
    }

    /// Returns true if a name of the domain with this prefix is among them.
    pub fn any_of(&self, prefix: &str) -> bool {
        self.0.iter().any(|name| prefix_of(name) == Some(prefix))
    }
}

/// Returns true if a living process has joined the domain with this prefix. It also returns true if it cannot tell:
/// after `give_up`, and for segments of another user, whose maps only root can read.
pub fn is_inhabited(prefix: &str, give_up: Instant) -> bool {
    let own = rustix::process::geteuid().as_raw();
    let hidden = own != 0 && segments(prefix).iter().any(|segment| segment.uid != own);
    hidden || Mapped::read(prefix, give_up).is_none_or(|mapped| mapped.any_of(prefix))
}

/// Refuses to start if a write to shared memory could end in SIGBUS: tmpfs hands out pages lazily.
pub(crate) fn check_room() -> Result<(), BusError> {
    check_room_in(Path::new(SHARED_MEMORY), SHARED_MEMORY_NEEDED_BYTES)
}

fn check_room_in(path: &Path, needed_bytes: u64) -> Result<(), BusError> {
    let stat = rustix::fs::statvfs(path)
        .map_err(|error| BusError::Root { path: path.to_owned(), reason: format!("no shared memory: {error}") })?;
    let free_bytes = stat.f_bavail.saturating_mul(stat.f_frsize);
    if free_bytes < needed_bytes {
        return Err(BusError::SharedMemoryFull { path: path.to_owned(), free_bytes, needed_bytes });
    }
    Ok(())
}

/// Takes the rights of other users away from the files in /dev/shm under `prefix`. The transport creates all
/// files but one without such rights. It creates the counter of its nodes for everybody. Files of another user
/// are left alone, because the transport refuses them.
pub(crate) fn close_to_others(prefix: &str) {
    let Ok(entries) = std::fs::read_dir(SHARED_MEMORY) else { return };
    for entry in entries.flatten().filter(|entry| entry.file_name().as_encoded_bytes().starts_with(prefix.as_bytes())) {
        let open = entry.metadata().is_ok_and(|metadata| metadata.is_file() && metadata.mode() & 0o077 != 0);
        if open {
            let own = std::fs::Permissions::from_mode(0o600);
            let _ = std::fs::set_permissions(entry.path(), own);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn check_room_error_names_full_or_missing_filesystem() {
        check_room().expect("the test machine has room");
        let error = check_room_in(Path::new(SHARED_MEMORY), u64::MAX).expect_err("no machine has that much");
        let text = error.to_string();
        assert!(text.starts_with("/dev/shm: ") && text.contains("18446744073709551615 are needed"), "{text}");
        let error = check_room_in(Path::new("/nowhere/at/all"), 1).expect_err("it does not exist");
        assert!(error.to_string().contains("/nowhere/at/all"), "{error}");
    }
}
