//! A domain of its own for every test.
// Each test binary uses a part of it.
#![allow(dead_code)]

use bus::{Domain, DomainConfig, Reader, Writer};
use messages::{JointTarget, Layout, Service};
use std::path::PathBuf;
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

    /// Returns the paths of the domain's files in /dev/shm.
    pub(crate) fn files(&self) -> Vec<String> {
        let entries = std::fs::read_dir("/dev/shm").into_iter().flatten().flatten();
        let ours = entries.filter(|entry| entry.file_name().to_string_lossy().starts_with(&self.prefix));
        ours.map(|entry| entry.path().display().to_string()).collect()
    }

    /// Returns their size.
    pub(crate) fn bytes(&self) -> u64 {
        self.files().iter().filter_map(|path| std::fs::metadata(path).ok()).map(|data| data.len()).sum()
    }

    pub(crate) fn open(&self) -> Domain {
        Domain::open(self.config(), "test").expect("the domain opens")
    }
}

impl Drop for Place {
    fn drop(&mut self) {
        self.files().iter().for_each(|path| _ = std::fs::remove_file(path));
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

pub(crate) fn message(incarnation: u32, k: u64) -> JointTarget {
    let mut target = JointTarget::ZERO;
    (target.header.incarnation, target.k, target.q[16]) = (incarnation, k, k as f64);
    target
}

pub(crate) fn writer(domain: &Domain) -> Writer<JointTarget> {
    domain.writer(Service::JointTarget).expect("the writer's place is free")
}

pub(crate) fn reader(domain: &Domain) -> Reader<JointTarget> {
    domain.reader(Service::JointTarget).expect("a reader's place is free")
}
