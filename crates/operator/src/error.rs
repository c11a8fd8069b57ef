//! What can go wrong before and between heartbeats.

use rustix::io::Errno;
use std::path::PathBuf;

/// Why a socket could not be opened or an exchange failed.
#[derive(Debug, thiserror::Error)]
pub enum OperatorError {
    /// There is no socket.
    #[error("{}: no such socket: is teleopd control running?", path.display())]
    NoSocket {
        /// The socket.
        path: PathBuf,
    },
    /// A socket file that nobody listens on.
    #[error("{}: nobody listens on this socket: teleopd control has ended without removing it", path.display())]
    NobodyAnswers {
        /// The socket.
        path: PathBuf,
    },
    /// The file system forbids it.
    #[error("{}: permission denied: the socket is open to its owner and its group (mode 0660)", path.display())]
    PermissionDenied {
        /// The socket, or the directory of one to be made.
        path: PathBuf,
    },
    /// A second server.
    #[error("{}: another teleopd control answers on this socket: end it first, or give this one another path", path.display())]
    InUse {
        /// The socket.
        path: PathBuf,
    },
    /// A file that is no socket is never replaced.
    #[error("{}: exists and is not a socket: it is left alone, move it away or give another path", path.display())]
    NotASocket {
        /// The file.
        path: PathBuf,
    },
    /// The directory of the socket does not exist.
    #[error("{}: the directory of the control socket does not exist: create it first", path.display())]
    NoDirectory {
        /// The directory.
        path: PathBuf,
    },
    /// A path that does not fit into a socket address.
    #[error("{}: too long for the path of a Unix socket (at most 107 bytes)", path.display())]
    PathTooLong {
        /// The path.
        path: PathBuf,
    },
    /// No reply in time.
    #[error("{}: teleopd control did not reply within {timeout_ms} ms", path.display())]
    Timeout {
        /// The socket.
        path: PathBuf,
        /// What was waited for.
        timeout_ms: u64,
    },
    /// The server ended the connection.
    #[error(
        "{}: teleopd control closed the connection: it ended, is full, or is of another version than this client", path.display()
    )]
    Closed {
        /// The socket.
        path: PathBuf,
    },
    /// A reply of a wrong length.
    #[error("{}: a reply of {bytes} bytes, expected {expected}: teleopd control is of another version than this client", path.display())]
    BadReply {
        /// The socket.
        path: PathBuf,
        /// Length of the reply.
        bytes: usize,
        /// Length of a `Status`.
        expected: usize,
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
