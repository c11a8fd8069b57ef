//! The processes that have a domain open, and the removal of the files that dead ones left in it.
//!
//! Every process that opens a domain holds a shared lock on a file in the domain's root. The kernel releases the lock
//! when the process ends, however it ends. A process that gets the exclusive lock knows that no other process holds the
//! domain open. It then removes the files and shared memory of dead processes. It tries this before it creates
//! anything, and again after its last port is closed. Clients that use iceoryx2 directly hold no such lock. Therefore
//! nothing is removed while the transport lists a live node, or while a process has mapped one of the segments.

use crate::domain::DomainConfig;
use crate::shared_memory::{self, Mapped};
use iceoryx2::node::NodeState;
use iceoryx2::prelude::{CallbackProgression, Config, Node, SemanticString, ipc};
use rustix::fs::{self, FlockOperation, Mode, OFlags};
use std::os::fd::OwnedFd;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// The lock file, in the root of the domain. It stays, because removing a lock file is a race.
const LOCK: &str = "presence.lock";
/// Longest wait for the lock when a domain is opened, and longest removal. Assumption: not noticeable at a start.
const WITHIN: Duration = Duration::from_secs(2);
/// Pause between two attempts to take the lock.
const PAUSE: Duration = Duration::from_millis(2);
/// Files that one removal looks at. Assumption: more than 32 nodes of a domain can leave.
const FILES_MAX: usize = 10_000;

/// The lock of a process on an open domain. The domain and each of its ports hold it.
pub(crate) struct Presence {
    config: DomainConfig,
    transport: Config,
    /// `None` if the lock file cannot be created. Then nothing is removed.
    lock: Option<OwnedFd>,
}

impl Presence {
    /// Takes the shared lock of a domain whose root exists. First removes the files of dead processes if no other
    /// process is there.
    pub(crate) fn enter(config: &DomainConfig, transport: &Config) -> Self {
        let flags = OFlags::CREATE | OFlags::RDWR | OFlags::CLOEXEC | OFlags::NOFOLLOW;
        let lock = fs::open(config.root.join(LOCK), flags, Mode::RUSR | Mode::WUSR).ok();
        let presence = Self { config: config.clone(), transport: transport.clone(), lock };
        let give_up = Instant::now() + WITHIN;
        // A process without the lock is still listed as a live node, so its files stay.
        while !presence.try_enter() && Instant::now() < give_up {
            std::thread::sleep(PAUSE);
        }
        presence
    }

    /// Returns true if it got the shared lock. It does not while another process removes files.
    fn try_enter(&self) -> bool {
        self.remove_if_alone();
        self.locks(FlockOperation::NonBlockingLockShared)
    }

    fn locks(&self, operation: FlockOperation) -> bool {
        self.lock.as_ref().is_some_and(|lock| fs::flock(lock, operation).is_ok())
    }

    fn remove_if_alone(&self) {
        if self.locks(FlockOperation::NonBlockingLockExclusive) {
            self.remove_what_is_left();
        }
    }

    fn remove_what_is_left(&self) {
        let own_uid = rustix::process::geteuid().as_raw();
        if !std::fs::metadata(&self.config.root).is_ok_and(|root| root.uid() == own_uid) {
            return;
        }
        // The files are listed before the search for live nodes, so a client's later files are not among them.
        let give_up = Instant::now() + WITHIN;
        let (segments, files) = (shared_memory::segments(&self.config.prefix), self.files());
        if segments.is_empty() && files.is_empty() || self.somebody_lives() {
            return;
        }
        let Some(mapped) = Mapped::read(&self.config.prefix, give_up) else { return };
        // For example, an instance with the same path in another mount namespace has mapped it.
        if mapped.any_of(&self.config.prefix) {
            return;
        }
        for segment in segments.iter().filter(|segment| segment.uid == own_uid) {
            let _ = std::fs::remove_file(segment.path());
        }
        for path in files {
            // A folder comes after its files.
            let _ = if path.is_dir() { std::fs::remove_dir(&path) } else { std::fs::remove_file(&path) };
        }
    }

    /// Returns true if the transport lists a node that is alive, or whose state is unknown.
    fn somebody_lives(&self) -> bool {
        let mut lives = false;
        let listed = Node::<ipc::Service>::list(&self.transport, |node| {
            lives |= !matches!(node, NodeState::Dead(_));
            if lives { CallbackProgression::Stop } else { CallbackProgression::Continue }
        });
        lives || listed.is_err()
    }

    /// Returns the transport's files in the root: sockets with this prefix, and descriptions of nodes and services.
    fn files(&self) -> Vec<PathBuf> {
        let name = |path: &iceoryx2::prelude::Path| String::from_utf8_lossy(path.as_bytes()).into_owned();
        let global = &self.transport.global;
        let [nodes, services] =
            [&global.node.directory, &global.service.directory].map(|path| self.config.root.join(name(path)));
        let mut found = Vec::new();
        let add = |folder: &Path, found: &mut Vec<PathBuf>| {
            let entries = std::fs::read_dir(folder).into_iter().flatten().flatten().take(FILES_MAX);
            let ours = entries.filter(|e| e.file_name().as_encoded_bytes().starts_with(self.config.prefix.as_bytes()));
            found.extend(ours.map(|entry| entry.path()).filter(|path| !path.is_dir()));
        };
        add(&self.config.root, &mut found);
        add(&services, &mut found);
        add(&nodes, &mut found);
        // Each node has a folder, whose name is a number.
        for entry in std::fs::read_dir(&nodes).into_iter().flatten().flatten().take(FILES_MAX) {
            if entry.file_name().as_encoded_bytes().iter().all(u8::is_ascii_digit) {
                add(&entry.path(), &mut found);
                found.push(entry.path());
            }
        }
        found
    }
}

impl Drop for Presence {
    fn drop(&mut self) {
        self.remove_if_alone();
    }
}
