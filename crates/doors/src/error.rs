//! Why a door cannot be opened or entered.

use crate::protocol::Reply;
use rustix::io::Errno;
use std::path::PathBuf;

/// Why a socket could not be made or reached. `daemon` is the process it belongs to.
#[derive(Debug, thiserror::Error)]
pub enum DoorError {
    /// There is no socket.
    #[error("{}: no such socket: is {daemon} running? (`teleopd up` starts all)", path.display())]
    NoSocket {
        /// The socket.
        path: PathBuf,
        /// Whose it is.
        daemon: &'static str,
    },
    /// A socket file that nobody listens on.
    #[error("{}: nobody listens on this socket: {daemon} has ended without removing it", path.display())]
    NobodyAnswers {
        /// The socket.
        path: PathBuf,
        /// Whose it is.
        daemon: &'static str,
    },
    /// The file system forbids it.
    #[error("{}: permission denied: the socket is open to its owner and its group (mode 0660)", path.display())]
    PermissionDenied {
        /// The socket, or the directory of one to be made.
        path: PathBuf,
    },
    /// The socket cannot be given to its group.
    #[error("{}: cannot give the socket to group {gid}: {source}: {daemon} must be a member of it", path.display())]
    Group {
        /// The socket.
        path: PathBuf,
        /// The group.
        gid: u32,
        /// Whose it is.
        daemon: &'static str,
        /// What the kernel said.
        source: Errno,
    },
    /// A second server.
    #[error("{}: another {daemon} answers on this socket: end it first, or give this one another path", path.display())]
    InUse {
        /// The socket.
        path: PathBuf,
        /// Whose it is.
        daemon: &'static str,
    },
    /// A file that is no socket is never replaced.
    #[error("{}: exists and is not a socket: it is left alone, move it away or give another path", path.display())]
    NotASocket {
        /// The file.
        path: PathBuf,
    },
    /// The directory of the socket does not exist.
    #[error("{}: the directory of the socket of {daemon} does not exist: create it first", path.display())]
    NoDirectory {
        /// The directory.
        path: PathBuf,
        /// Whose it is.
        daemon: &'static str,
    },
    /// A path that does not fit into a socket address.
    #[error("{}: too long for the path of a Unix socket (at most 107 bytes)", path.display())]
    PathTooLong {
        /// The path.
        path: PathBuf,
    },
    /// No answer in time.
    #[error("{}: {daemon} did not reply within {timeout_ms} ms", path.display())]
    Timeout {
        /// The socket.
        path: PathBuf,
        /// Whose it is.
        daemon: &'static str,
        /// What was waited for.
        timeout_ms: u64,
    },
    /// The daemon says no.
    #[error("{}: refused: {}", path.display(), word.meaning())]
    Refused {
        /// The socket.
        path: PathBuf,
        /// Why.
        word: Reply,
    },
    /// The daemon ended the connection.
    #[error("{}: {daemon} closed the connection", path.display())]
    Closed {
        /// The socket.
        path: PathBuf,
        /// Whose it is.
        daemon: &'static str,
    },
    /// Anything else.
    #[error("{}: cannot {action}: {source}", path.display())]
    Os {
        /// The socket.
        path: PathBuf,
        /// What was tried.
        action: &'static str,
        /// What the kernel said.
        source: Errno,
    },
}
