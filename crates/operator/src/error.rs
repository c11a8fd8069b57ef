//! Errors before and between heartbeats.

use doors::DoorError;
use rustix::io::Errno;
use std::path::PathBuf;

const CLOSED: &str =
    "It ended, all its connections are in use, it does not admit this user, or its version differs from this client's";

/// Returned when a socket cannot be opened or an exchange fails.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs, reason = "the texts name the fields")]
pub enum OperatorError {
    #[error(transparent)]
    Door(#[from] DoorError),
    #[error("{}: teleopd control did not reply within {timeout_ms} ms{}", path.display(), doors::hint(path))]
    Timeout { path: PathBuf, timeout_ms: u64 },
    #[error(
        "{}: teleopd control closed the connection. {}", path.display(), doors::linked_or(path, CLOSED)
    )]
    Closed { path: PathBuf },
    #[error(
        "{}: a reply has {bytes} bytes, expected {expected}. The versions of teleopd control and this client \
         differ", path.display()
    )]
    BadReply { path: PathBuf, bytes: usize, expected: usize },
    #[error(
        "{}: pressed, and the link repeats it. Robot {robot} has not answered within {within_s} s, so it may not have stopped. \
         Use the robot's own emergency stop", path.display()
    )]
    Unanswered { path: PathBuf, robot: String, within_s: u64 },
    #[error("cannot start the operator's thread: {cause}")]
    Thread { cause: String },
    #[error("{}: cannot {action}: {source}", path.display())]
    Os { path: PathBuf, action: &'static str, source: Errno },
}

impl From<OperatorError> for rt::Failure {
    fn from(error: OperatorError) -> Self {
        Self::new(rt::Exit::Unavailable, error)
    }
}
