//! A domain of its own for every test.
// Each test binary uses a part of it.
#![allow(dead_code)]

use bus::{Domain, DomainConfig};
use std::path::{Path, PathBuf};
use std::time::Duration;

/// A root folder and a prefix that no other test has. Both are removed with it.
pub(crate) struct Place {
    folder: tempfile::TempDir,
    prefix: String,
}

impl Place {
    pub(crate) fn new(name: &str) -> Self {
        let folder = tempfile::Builder::new().prefix("bus").tempdir().expect("a folder");
        Self { folder, prefix: format!("t{}_{}_{name}_", std::process::id(), rt::incarnation()) }
    }

    pub(crate) fn config(&self) -> DomainConfig {
        DomainConfig { root: self.root(), prefix: self.prefix.clone() }
    }

    pub(crate) fn root(&self) -> PathBuf {
        self.folder.path().join("root")
    }

    pub(crate) fn open(&self) -> Domain {
        Domain::open(self.config(), "test").expect("the domain opens")
    }
}

impl Drop for Place {
    fn drop(&mut self) {
        for entry in std::fs::read_dir("/dev/shm").into_iter().flatten().flatten() {
            if entry.file_name().to_string_lossy().starts_with(&self.prefix) {
                let _ = std::fs::remove_file(entry.path());
            }
        }
    }
}

/// Waits until `check` returns a value. A minute without one is a failure of the test, whatever the load.
pub(crate) fn eventually<T>(what: &str, mut check: impl FnMut() -> Option<T>) -> T {
    let mut found = None;
    let happened = wait::within(Duration::from_secs(60), || {
        found = check();
        found.is_some()
    });
    assert!(happened, "never happened: {what}");
    found.expect("it happened")
}

/// Returns the size of the files in /dev/shm whose names begin with `prefix`.
pub(crate) fn shared_memory_bytes(prefix: &str) -> u64 {
    let entries = std::fs::read_dir(Path::new("/dev/shm")).into_iter().flatten().flatten();
    let ours = entries.filter(|entry| entry.file_name().to_string_lossy().starts_with(prefix));
    ours.filter_map(|entry| entry.metadata().ok()).map(|data| data.len()).sum()
}
