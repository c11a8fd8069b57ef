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
    if error.raw_os_error().is_none() {
        return format!("{name}: {error}");
    }
    match error.kind() {
        ErrorKind::NotFound => {
            format!("{name}: there is no such file. Check the path; it is relative to the current folder")
        }
        ErrorKind::PermissionDenied => {
            format!("{name}: Permission denied. Run this as the user who may read it (ls -l {name})")
        }
        ErrorKind::IsADirectory => format!("{name} is a folder. Give the name of a file"),
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

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs::{File, OpenOptions};

    fn refused(result: std::io::Result<File>) -> Error {
        result.expect_err("it is refused")
    }

    #[test]
    fn taken_port_error_names_option_for_another_port() {
        let taken = std::net::TcpListener::bind("127.0.0.1:0").expect("a port");
        let address = taken.local_addr().expect("its address");
        let error = std::net::TcpListener::bind(address).expect_err("it is taken");
        let text = port_refused(address.port(), "--view-port", &error);
        assert!(text.contains(&address.port().to_string()) && text.contains("--view-port 0"), "{text}");
        assert!(!text.contains("os error"), "{text}");
    }

    #[test]
    fn file_error_gives_advice_without_error_number() {
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("there.mcap");
        File::create(&file).expect("a file");
        let create = |path: &Path| refused(OpenOptions::new().write(true).create_new(true).open(path));
        let below = file.join("x.csv");
        let nowhere = folder.path().join("no/x.csv");
        for (path, error, advice) in [
            (file.as_path(), create(&file), "Remove it, or give another name"),
            (&nowhere, create(&nowhere), "mkdir -p "),
            (&below, create(&below), "not a folder"),
            (folder.path(), refused(File::create(folder.path())), "the name of a file"),
        ] {
            let text = unwritable(path, &error);
            assert!(text.contains(advice) && text.contains(&path.display().to_string()), "{text}");
            assert!(!text.contains("os error"), "{text}");
        }
        let text = unreadable(&nowhere, &refused(File::open(&nowhere)));
        assert!(
            text.contains("no such file") && text.contains("Check the path") && !text.contains("os error"),
            "{text}"
        );
        let ours = Error::other("the folder belongs to user 7");
        assert!(unwritable(&file, &ours).ends_with("the folder belongs to user 7"), "our own words stay");
        let other = Error::from_raw_os_error(5);
        assert!(unwritable(&file, &other).contains("os error 5"), "what is not known is said as it is");
    }
}
