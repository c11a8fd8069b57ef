//! Errors with the path, the service and the advice.

use std::path::PathBuf;

/// Set-up errors of the bus.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs, reason = "the texts name the fields")]
pub enum BusError {
    /// The root path cannot be used.
    #[error("bus root path \"{}\": {reason}", path.display())]
    Root { path: PathBuf, reason: String },
    /// The prefix cannot be used.
    #[error("bus prefix \"{prefix}\": {reason}")]
    Prefix { prefix: String, reason: String },
    /// The transport does not accept the node name.
    #[error("bus node name \"{name}\": {reason}")]
    NodeName { name: String, reason: String },
    /// The shared-memory filesystem is nearly full. Writing to it would end the process with SIGBUS.
    #[error(
        "{}: {free_bytes} bytes are free, {needed_bytes} are needed; enlarge it (Docker: --shm-size), or remove files \
         that ended programs left there", path.display()
    )]
    SharedMemoryFull { path: PathBuf, free_bytes: u64, needed_bytes: u64 },
    /// Opening the domain did not end in time.
    #[error(
        "bus at root \"{}\", prefix \"{prefix}\": no answer after {waited_ms} ms; if this computer was busy, try again; \
         else stop this instance, then remove the root, and {prefix}* in /dev/shm or /run/teleop/shm", root.display()
    )]
    Hangs { root: PathBuf, prefix: String, waited_ms: u64 },
    /// The folder belongs to another user.
    #[error(
        "{}: this instance belongs to user {owner}, and this program runs as user {own}. Shared memory serves one \
         user. Run this as that user (sudo -u '#{owner}' ...), or use the instance's socket: --socket {}",
        root.display(), root.with_file_name("skeleton.sock").display()
    )]
    Foreign { root: PathBuf, owner: u32, own: u32 },
    /// The domain was refused.
    #[error(
        "bus at root \"{}\", prefix \"{prefix}\": {cause}; does the root belong to the user that runs this process?",
        root.display()
    )]
    Node { root: PathBuf, prefix: String, cause: String },
    /// The message does not belong to the service.
    #[error("service {service}: the message is {offered}, expected {expected}")]
    WrongMessage { service: &'static str, expected: String, offered: &'static str },
    /// Another process uses another layout.
    #[error(
        "service {service} at root \"{}\": a running process uses another layout than {ours}; stop it, or use the same \
         version of teleopd everywhere", root.display()
    )]
    IncompatibleTypes {
        service: &'static str,
        root: PathBuf,
        /// Our type name, with version and layout hash.
        ours: String,
    },
    /// Every writer's place is taken.
    #[error(
        "{}another {writer} is already running ({writers_max} writer(s) at most, and a suspended process counts; \
         service {service} at root \"{}\")", running(root, *writers_max), root.display()
    )]
    WriterExists { service: &'static str, root: PathBuf, writer: &'static str, writers_max: usize },
    /// Every reader's place is taken.
    #[error("service {service} at root \"{}\": all {readers_max} readers are in use; end one of them", root.display())]
    ReadersExhausted { service: &'static str, root: PathBuf, readers_max: usize },
    /// The transport refused the service or one of its ports.
    #[error("service {service} at root \"{}\": {cause} (after {attempts} attempts){}", root.display(), hint(cause))]
    Service { service: &'static str, root: PathBuf, cause: String, attempts: u32 },
}

impl BusError {
    /// Returns true if another process holds the place. The instance runs already, or one of its processes was stopped.
    pub fn is_occupied(&self) -> bool {
        matches!(self, Self::WriterExists { .. } | Self::ReadersExhausted { .. })
    }
}

/// Returned when a message was not sent. It is for run time: small, `Copy`, made without allocating.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum PublishError {
    /// No memory was left for the message.
    #[error("no memory left for the message")]
    NoMemory,
    /// The connection to a reader could not be made.
    #[error("a reader could not be connected")]
    Connection,
    /// A reader did not get the message.
    #[error("a reader did not get the message")]
    Delivery,
    /// The event that wakes readers was not sent.
    #[error("the wake-up could not be sent")]
    Wake,
}

/// Names where the running instance is, for a service that one process of an instance writes. It is the folder
/// above the folders of its domains.
fn running(root: &std::path::Path, writers_max: usize) -> String {
    match root.parent() {
        Some(folder) if writers_max == 1 => format!("an instance already runs in {}: ", folder.display()),
        _ => String::new(),
    }
}

/// Explains a domain whose folder is there without its shared memory: the writer's /dev/shm is another one.
fn hint(cause: &str) -> &'static str {
    if cause.contains("HangsInCreation") {
        "; its owner has another /dev/shm, as under the systemd units. Publish through skeleton.sock \
         (examples/client.conf)"
    } else {
        ""
    }
}
