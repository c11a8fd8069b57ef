//! Errors of making and reaching a socket.

use crate::protocol::Reply;
use rustix::io::Errno;
use std::path::PathBuf;

/// Returned when a socket cannot be made or reached. `daemon` is the process that the socket belongs to.
#[derive(Debug, thiserror::Error)]
pub enum DoorError {
    /// The socket does not exist.
    #[error("{}: no such socket. Is {daemon} running? `teleopd up` starts everything", path.display())]
    NoSocket {
        /// The socket.
        path: PathBuf,
        /// The process that it belongs to.
        daemon: &'static str,
    },
    /// The socket file exists, but no process listens on it.
    #[error(
        "{}: no process listens on this socket. {daemon} ended without removing it; start it again", path.display()
    )]
    NobodyAnswers {
        /// The socket.
        path: PathBuf,
        /// The process that it belongs to.
        daemon: &'static str,
    },
    /// The file system forbids it.
    #[error("{}: permission denied. Only the socket's owner and its group may use it (mode 0660)", path.display())]
    PermissionDenied {
        /// The socket, or the directory of a socket to be made.
        path: PathBuf,
    },
    /// The socket cannot be given to its group.
    #[error(
        "{}: cannot give the socket to group {gid}: {source}. {daemon} must be a member of the group", path.display()
    )]
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
    #[error("{}: another {daemon} answers on this socket. End it first, or give this one another path", path.display())]
    InUse {
        /// The socket.
        path: PathBuf,
        /// The process that it belongs to.
        daemon: &'static str,
    },
    /// The path names a file that is not a socket. Such a file is never replaced.
    #[error(
        "{}: exists and is not a socket, so it is not replaced. Move it away, or give another path", path.display()
    )]
    NotASocket {
        /// The file.
        path: PathBuf,
    },
    /// The directory of the socket does not exist.
    #[error("{}: no such folder; {daemon} needs it for its socket. Create it first", path.display())]
    NoDirectory {
        /// The directory.
        path: PathBuf,
        /// The process that the socket belongs to.
        daemon: &'static str,
    },
    /// The path does not fit into a socket address.
    #[error("{}: the path is too long; a Unix socket's path has at most 107 bytes. Give a shorter one", path.display())]
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
