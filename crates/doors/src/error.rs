//! Errors of making and reaching a socket.

use crate::protocol::Reply;
use rustix::io::Errno;
use std::path::{Path, PathBuf};

/// File beside the sockets of a link's end at an operator's machine. It holds the name of the robot.
pub const LINK_FILE: &str = "link";

/// Returns the robot to which a link leads that serves the sockets of this folder.
pub fn linked_robot(run_dir: &Path) -> Option<String> {
    std::fs::read_to_string(run_dir.join(LINK_FILE)).ok()
}

fn link_of(socket: &Path) -> Option<String> {
    let robot = linked_robot(socket.parent()?)?;
    Some(format!(
        "Nothing reaches robot {robot}, which its link leads to and which releases by itself. See the lines of teleop-bridge link \
         operator, and start it again if it has ended. Use the robot's own emergency stop"
    ))
}

/// Returns what a link's socket adds to an error, if this one belongs to a link.
pub fn hint(socket: &Path) -> String {
    link_of(socket).map_or(String::new(), |text| format!(". {text}"))
}

/// Returns what an error of this socket means: the link's text if it belongs to a link.
pub fn linked_or(socket: &Path, otherwise: &str) -> String {
    link_of(socket).unwrap_or_else(|| otherwise.to_owned())
}

fn absent(socket: &Path, daemon: &str) -> String {
    let folder = socket.parent().unwrap_or(Path::new("."));
    let text = format!("Is {daemon} running? `teleopd up --run-dir {}` starts everything", folder.display());
    linked_or(socket, &text)
}

fn ended(socket: &Path, daemon: &str) -> String {
    linked_or(socket, &format!("{daemon} ended without removing it; start it again"))
}

/// Returned when a socket cannot be made or reached. `daemon` is the process that the socket belongs to.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs, reason = "the texts name the fields")]
pub enum DoorError {
    #[error("{}: no such socket. {}", path.display(), absent(path, daemon))]
    NoSocket { path: PathBuf, daemon: &'static str },
    #[error(
        "{}: no process listens on this socket. {}", path.display(), ended(path, daemon)
    )]
    NobodyAnswers { path: PathBuf, daemon: &'static str },
    #[error("{}: permission denied. Only the socket's owner and its group may use it (mode 0660)", path.display())]
    PermissionDenied { path: PathBuf },
    #[error(
        "{}: cannot give the socket to group {gid}: {source}. {daemon} must be a member of the group", path.display()
    )]
    Group { path: PathBuf, gid: u32, daemon: &'static str, source: Errno },
    #[error("{}: another {daemon} answers on this socket. End it first, or give this one another path", path.display())]
    InUse { path: PathBuf, daemon: &'static str },
    #[error(
        "{}: exists and is not a socket, so it is not replaced. Move it away, or give another path", path.display()
    )]
    NotASocket { path: PathBuf },
    #[error("{}: no such folder; {daemon} needs it for its socket. Create it first", path.display())]
    NoDirectory { path: PathBuf, daemon: &'static str },
    #[error("{}: the path is too long; a Unix socket's path has at most 107 bytes. Give a shorter one", path.display())]
    PathTooLong { path: PathBuf },
    #[error("{}: {daemon} did not reply within {timeout_ms} ms{}", path.display(), hint(path))]
    Timeout { path: PathBuf, daemon: &'static str, timeout_ms: u64 },
    #[error("{}: refused: {}", path.display(), word.meaning())]
    Refused { path: PathBuf, word: Reply },
    #[error("{}: {daemon} closed the connection{}", path.display(), hint(path))]
    Closed { path: PathBuf, daemon: &'static str },
    #[error("{}: cannot {action}: {source}", path.display())]
    Os { path: PathBuf, action: &'static str, source: Errno },
}
