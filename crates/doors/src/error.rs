//! Errors of making and reaching a socket.

use crate::protocol::Reply;
use rustix::io::Errno;
use std::path::PathBuf;

/// Returned when a socket cannot be made or reached. `daemon` is the process that the socket belongs to.
#[derive(Debug, thiserror::Error)]
pub enum DoorError {
    /// The socket does not exist.
    #[error("{}: no such socket: is {daemon} running? (`teleopd up` starts all)", path.display())]
    NoSocket {
        /// The socket.
        path: PathBuf,
        /// The process that it belongs to.
        daemon: &'static str,
    },
    /// The socket file exists, but no process listens on it.
    #[error("{}: nobody listens on this socket: {daemon} has ended without removing it", path.display())]
    NobodyAnswers {
        /// The socket.
        path: PathBuf,
        /// The process that it belongs to.
        daemon: &'static str,
    },
    /// The file system forbids it.
    #[error("{}: permission denied: the socket is open to its owner and its group (mode 0660)", path.display())]
    PermissionDenied {
        /// The socket, or the directory of a socket to be made.
        path: PathBuf,
    },
    /// The socket cannot be given to its group.
    #[error("{}: cannot give the socket to group {gid}: {source}: {daemon} must be a member of it", path.display())]
    Group {
        /// The socket.
        path: PathBuf,
        /// The group.
        gid: u32,
        /// The process that it belongs to.
        daemon: &'static str,
        /// The kernel's error.
        source: Errno,
    },
    /// Another server listens on this socket already.
    #[error("{}: another {daemon} answers on this socket: end it first, or give this one another path", path.display())]
    InUse {
        /// The socket.
        path: PathBuf,
        /// The process that it belongs to.
        daemon: &'static str,
    },
    /// The path names a file that is not a socket. Such a file is never replaced.
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
        /// The process that the socket belongs to.
        daemon: &'static str,
    },
    /// The path does not fit into a socket address.
    #[error("{}: too long for the path of a Unix socket (at most 107 bytes)", path.display())]
    PathTooLong {
        /// The path.
        path: PathBuf,
    },
    /// The daemon did not reply in time.
    #[error("{}: {daemon} did not reply within {timeout_ms} ms", path.display())]
    Timeout {
        /// The socket.
        path: PathBuf,
        /// The process that it belongs to.
        daemon: &'static str,
        /// Length of the wait, ms.
        timeout_ms: u64,
    },
    /// The daemon refused this client.
    #[error("{}: refused: {}", path.display(), word.meaning())]
    Refused {
        /// The socket.
        path: PathBuf,
        /// The reason.
        word: Reply,
    },
    /// The daemon ended the connection.
    #[error("{}: {daemon} closed the connection", path.display())]
    Closed {
        /// The socket.
        path: PathBuf,
        /// The process that it belongs to.
        daemon: &'static str,
    },
    /// Any other error of the kernel.
    #[error("{}: cannot {action}: {source}", path.display())]
    Os {
        /// The socket.
        path: PathBuf,
        /// The action that failed.
        action: &'static str,
        /// The kernel's error.
        source: Errno,
    },
}
