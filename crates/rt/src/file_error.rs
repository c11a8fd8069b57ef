//! Advice in words for a file or a port that the operating system refuses. An error number alone does not help
//! the user.

use std::io::{Error, ErrorKind};
use std::path::Path;

/// Returns the reason why `path` cannot be created or written, and the remedy.
pub fn unwritable(path: &Path, error: &Error) -> String {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let (name, folder) = (path.display(), folder.display());
    if error.raw_os_error().is_none() {
        return format!("{name}: {error}");
    }
    match error.kind() {
        ErrorKind::AlreadyExists => {
            format!("{name} exists already, and is not replaced. Remove it, or give another name")
        }
        ErrorKind::NotFound => {
            format!("{name}: there is no folder {folder}. Make it (mkdir -p {folder}), or give another path")
        }
        ErrorKind::NotADirectory => format!("{name}: {folder} is a file, not a folder. Give another path"),
        ErrorKind::IsADirectory => format!("{name} is a folder. Give the name of a file"),
        ErrorKind::PermissionDenied => {
            format!("{name}: Permission denied. Give a path in a folder of your own")
        }
        ErrorKind::ReadOnlyFilesystem => format!("{name}: its disk is read-only. Give a path on another one"),
        ErrorKind::StorageFull => format!("{name}: its disk is full. Make room, or give a path on another one"),
        _ => format!("{name}: {error}"),
    }
}

/// Returns the reason why `path` cannot be read, and the remedy.
pub fn unreadable(path: &Path, error: &Error) -> String {
    let name = path.display();
    match error.kind() {
        ErrorKind::InvalidData => format!("{name} is no text in UTF-8. Save it as such, or give another file"),
        _ if error.raw_os_error().is_none() => format!("{name}: {error}"),
        ErrorKind::NotFound => {
            format!("{name}: there is no such file. Check the path; it is relative to the current folder")
        }
        ErrorKind::PermissionDenied => {
            format!("{name}: Permission denied. Run this as the user who may read it (ls -l {name})")
        }
        ErrorKind::IsADirectory => format!("{name} is a folder. Give the name of a file"),
        ErrorKind::NotADirectory => format!("{name}: a file is where a folder must be. Check the path"),
        _ => format!("{name}: {error}"),
    }
}

/// Returns the reason why this machine does not open `port`, which the option `option` sets, and the remedy.
pub fn port_refused(port: u16, option: &str, error: &Error) -> String {
    match error.kind() {
        ErrorKind::AddrInUse => format!(
            "port {port} of this machine is in use by another program. End that one (ss -ltnp 'sport = :{port}' names \
             it), or give another port: {option} 0 takes any free one"
        ),
        ErrorKind::PermissionDenied => {
            format!(
                "only root may use port {port} of this machine. Give one above 1023, or {option} 0 for any free one"
            )
        }
        _ => format!("port {port} of 127.0.0.1: {error}"),
    }
}
