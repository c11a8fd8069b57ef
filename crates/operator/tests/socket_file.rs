//! The file of the socket: permissions to bind and connect, and what a server replaces.

use doors::DoorError;
use operator::{Client, OperatorError, Server};
use rustix::net::{AddressFamily, SocketAddrUnix, SocketType};
use std::os::unix::fs::{FileTypeExt, PermissionsExt};
use tempfile::TempDir;

#[test]
fn socket_has_mode_0660_and_is_removed_with_its_server() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("control.sock");
    let server = Server::bind(&path).unwrap();
    let metadata = std::fs::metadata(&path).unwrap();
    assert!(metadata.file_type().is_socket());
    assert_eq!(metadata.permissions().mode() & 0o777, 0o660);
    drop(server);
    assert!(!path.exists());
    let error = Client::connect(&path).err().unwrap();
    assert!(matches!(error, OperatorError::Door(DoorError::NoSocket { .. })));
    assert!(error.to_string().contains("Is teleopd control running?"), "{error}");
}

#[test]
fn socket_file_is_replaced_only_if_no_process_listens() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("control.sock");
    let server = Server::bind(&path).unwrap();
    assert!(matches!(Server::bind(&path).err().unwrap(), OperatorError::Door(DoorError::InUse { .. })));
    drop(server);

    // The file was left by a killed server: it was bound once, and nobody listens.
    let address = SocketAddrUnix::new(&path).unwrap();
    let dead = rustix::net::socket(AddressFamily::UNIX, SocketType::SEQPACKET, None).unwrap();
    rustix::net::bind(&dead, &address).unwrap();
    drop(dead);
    assert!(matches!(Client::connect(&path).err().unwrap(), OperatorError::Door(DoorError::NobodyAnswers { .. })));
    drop(Server::bind(&path).unwrap());

    // Another program listens, without our lock.
    let foreign = rustix::net::socket(AddressFamily::UNIX, SocketType::SEQPACKET, None).unwrap();
    rustix::net::bind(&foreign, &address).unwrap();
    rustix::net::listen(&foreign, 1).unwrap();
    assert!(matches!(Server::bind(&path).err().unwrap(), OperatorError::Door(DoorError::InUse { .. })));
    assert!(path.exists());
    std::fs::remove_file(&path).unwrap();

    std::fs::write(&path, "precious").unwrap();
    assert!(matches!(Server::bind(&path).err().unwrap(), OperatorError::Door(DoorError::NotASocket { .. })));
    assert_eq!(std::fs::read(&path).unwrap(), b"precious");
}

#[test]
fn bind_error_names_missing_folder_or_long_path() {
    let folder = TempDir::new().unwrap();
    let error = Server::bind(folder.path().join("absent/control.sock")).err().unwrap();
    assert!(
        matches!(&error, OperatorError::Door(DoorError::NoDirectory { path, .. }) if path.ends_with("absent")),
        "{error}"
    );
    let long = folder.path().join("x".repeat(120));
    assert!(matches!(Server::bind(&long).err().unwrap(), OperatorError::Door(DoorError::PathTooLong { .. })));
    assert!(matches!(Client::connect(&long).err().unwrap(), OperatorError::Door(DoorError::PathTooLong { .. })));
}

#[test]
fn connect_error_names_forbidden_socket() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("control.sock");
    let _server = Server::bind(&path).unwrap();
    std::fs::set_permissions(folder.path(), std::fs::Permissions::from_mode(0o755)).unwrap();
    std::fs::set_permissions(&path, std::fs::Permissions::from_mode(0o0)).unwrap();
    let connects = || {
        // Root is forbidden nothing, so it becomes another user on this thread. Others stay who they are.
        let stranger = rustix::process::Uid::from_raw(42_424);
        let _ = rustix::thread::set_thread_res_uid(stranger, stranger, stranger);
        Client::connect(&path).err().unwrap()
    };
    let error = std::thread::scope(|scope| scope.spawn(connects).join().unwrap());
    assert!(matches!(&error, OperatorError::Door(DoorError::PermissionDenied { .. })), "{error}");
}
