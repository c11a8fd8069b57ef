//! Room in the shared-memory filesystem.

use crate::error::BusError;
use std::os::unix::fs::{MetadataExt, PermissionsExt};
use std::path::Path;

/// Where POSIX shared memory lives on Linux (shm_overview(7)).
const SHARED_MEMORY: &str = "/dev/shm";
/// What one domain may need: 8 clients with 20 readers took 1.0 MiB (2026-11); 16 times that leaves room for restarts,
/// whose predecessors' memory goes only when they are cleaned up.
pub const SHARED_MEMORY_NEEDED_BYTES: u64 = 16 << 20;

/// Refuses to start where a write to shared memory could end in SIGBUS: tmpfs hands out pages lazily.
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

/// Takes the rights of other users from what lies there under `prefix`. All but one file is made without any; the transport
/// makes the counter of its nodes for everybody. What belongs to another user is left alone: the transport refuses it.
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
    fn a_full_or_missing_filesystem_is_named() {
        check_room().expect("the test machine has room");
        let error = check_room_in(Path::new(SHARED_MEMORY), u64::MAX).expect_err("no machine has that much");
        let text = error.to_string();
        assert!(text.starts_with("/dev/shm: ") && text.contains("18446744073709551615 are needed"), "{text}");
        let error = check_room_in(Path::new("/nowhere/at/all"), 1).expect_err("it does not exist");
        assert!(error.to_string().contains("/nowhere/at/all"), "{error}");
    }
}
