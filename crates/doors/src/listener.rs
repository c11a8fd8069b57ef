//! A socket file for processes of other users, and the check that decides which of them may enter.

use crate::error::DoorError;
use rt::Peer;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fs::{self, FileType, FlockOperation, Gid, Mode, OFlags};
use rustix::io::Errno;
use rustix::net::sockopt::{self, Timeout};
use rustix::net::{self, AddressFamily, SocketAddrUnix, SocketFlags, SocketType};
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::path::{Path, PathBuf};
use std::time::Duration;

/// A new connection, and the result of the check.
#[derive(Debug)]
pub enum Admission {
    /// The peer is root, the daemon's user, or a member of the socket's group.
    Admitted(OwnedFd, Peer),
    /// The peer is any other user. The caller may send a refusal before it closes the connection.
    Forbidden(OwnedFd, Peer),
}

/// A listening SEQPACKET socket of mode 0660. It is bound once. Accepting neither blocks nor allocates.
#[derive(Debug)]
pub struct Listener {
    path: PathBuf,
    socket: OwnedFd,
    uid: u32,
    gid: u32,
    /// Held as long as the listener lives. If two servers start at once, one of them finds it locked.
    _lock: OwnedFd,
}

impl Listener {
    /// Listens on `path` for `daemon`, mode 0660. The socket gets `group` if given, and otherwise the group of
    /// the process. A socket file without a listener is replaced. Any other file is left alone. A file
    /// `path`.lock beside it keeps two servers from replacing each other. At most `waiting` connections queue.
    pub fn bind(path: &Path, daemon: &'static str, group: Option<u32>, waiting: usize) -> Result<Self, DoorError> {
        let path = path.to_path_buf();
        let address = SocketAddrUnix::new(&path).map_err(|_| DoorError::PathTooLong { path: path.clone() })?;
        let lock = lock(&path, daemon)?;
        remove_stale(&path, &address, daemon)?;
        let os = |action| failed(&path, action);
        let socket = socket(SocketFlags::NONBLOCK).map_err(os("create a Unix SEQPACKET socket"))?;
        net::bind(&socket, &address).map_err(|errno| match errno {
            Errno::ACCESS | Errno::PERM => DoorError::PermissionDenied { path: path.clone() },
            source => DoorError::Os { path: path.clone(), action: "bind the socket", source },
        })?;
        // Group and mode are set before `listen`, so that no client connects under those that process and umask
        // gave.
        let made = fs::lstat(&path).map_err(os("examine the socket"))?;
        if let Some(gid) = group.filter(|&gid| gid != made.st_gid) {
            fs::chown(&path, None, Some(Gid::from_raw(gid))).map_err(|source| DoorError::Group {
                path: path.clone(),
                gid,
                daemon,
                source,
            })?;
        }
        fs::chmod(&path, Mode::RUSR | Mode::WUSR | Mode::RGRP | Mode::WGRP)
            .map_err(os("set the mode of the socket"))?;
        net::listen(&socket, waiting as i32).map_err(os("listen on the socket"))?;
        let uid = rustix::process::geteuid().as_raw();
        Ok(Self { path, socket, uid, gid: group.unwrap_or(made.st_gid), _lock: lock })
    }

    /// Accepts a waiting connection. Returns `None` if there is none.
    pub fn accept(&self) -> Option<Admission> {
        // accept(2) creates a socket before it looks whether a connection waits: ten times the time of poll(2).
        let mut waiting = [PollFd::new(&self.socket, PollFlags::IN)];
        if poll(&mut waiting, Some(&Timespec { tv_sec: 0, tv_nsec: 0 })).ok()? == 0 {
            return None;
        }
        let socket = net::accept_with(&self.socket, SocketFlags::CLOEXEC | SocketFlags::NONBLOCK).ok()?;
        let peer = Peer::from_socket(socket.as_fd()).ok()?;
        let known = peer.uid == 0 || peer.uid == self.uid || peer.is_member(socket.as_fd(), self.gid);
        Some(if known { Admission::Admitted(socket, peer) } else { Admission::Forbidden(socket, peer) })
    }
}

impl AsFd for Listener {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.socket.as_fd()
    }
}

impl Drop for Listener {
    fn drop(&mut self) {
        // The lock is still held. If this fails, the next server finds a stale file and replaces it.
        let _ = fs::unlink(&self.path);
    }
}

/// Connects to the socket of `daemon` at `path`. Each receive and each send waits at most `timeout_ms`.
pub fn connect(path: &Path, daemon: &'static str, timeout_ms: u64) -> Result<OwnedFd, DoorError> {
    let path = path.to_path_buf();
    let address = SocketAddrUnix::new(&path).map_err(|_| DoorError::PathTooLong { path: path.clone() })?;
    let os = |action| failed(&path, action);
    let socket = socket(SocketFlags::empty()).map_err(os("create a Unix SEQPACKET socket"))?;
    for which in [Timeout::Recv, Timeout::Send] {
        sockopt::set_socket_timeout(&socket, which, Some(Duration::from_millis(timeout_ms.max(1))))
            .map_err(os("set the timeout of the socket"))?;
    }
    match net::connect(&socket, &address) {
        Ok(()) => Ok(socket),
        Err(Errno::NOENT | Errno::NOTDIR) => Err(DoorError::NoSocket { path, daemon }),
        Err(Errno::CONNREFUSED) => Err(DoorError::NobodyAnswers { path, daemon }),
        Err(Errno::ACCESS | Errno::PERM) => Err(DoorError::PermissionDenied { path }),
        Err(Errno::AGAIN | Errno::TIMEDOUT | Errno::INPROGRESS) => Err(DoorError::Timeout { path, daemon, timeout_ms }),
        Err(Errno::PROTOTYPE) => Err(DoorError::NotASocket { path }),
        Err(source) => Err(DoorError::Os { path, action: "connect", source }),
    }
}

fn failed(path: &Path, action: &'static str) -> impl Fn(Errno) -> DoorError {
    move |source| DoorError::Os { path: path.to_path_buf(), action, source }
}

fn socket(flags: SocketFlags) -> Result<OwnedFd, Errno> {
    net::socket_with(AddressFamily::UNIX, SocketType::SEQPACKET, flags | SocketFlags::CLOEXEC, None)
}

/// Locks `path`.lock. The lock file must not be a symbolic link.
fn lock(path: &Path, daemon: &'static str) -> Result<OwnedFd, DoorError> {
    let mut name = path.as_os_str().to_owned();
    name.push(".lock");
    let flags = OFlags::CREATE | OFlags::RDWR | OFlags::CLOEXEC | OFlags::NOFOLLOW;
    let file = fs::open(name.as_os_str(), flags, Mode::RUSR | Mode::WUSR).map_err(|errno| {
        let directory = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new(".")).to_path_buf();
        match errno {
            Errno::NOENT | Errno::NOTDIR => DoorError::NoDirectory { path: directory, daemon },
            Errno::ACCESS | Errno::PERM | Errno::ROFS => DoorError::PermissionDenied { path: directory },
            source => DoorError::Os { path: name.clone().into(), action: "open the lock file", source },
        }
    })?;
    match fs::flock(&file, FlockOperation::NonBlockingLockExclusive) {
        Ok(()) => Ok(file),
        Err(Errno::WOULDBLOCK) => Err(DoorError::InUse { path: path.to_path_buf(), daemon }),
        Err(source) => Err(DoorError::Os { path: name.into(), action: "lock the lock file", source }),
    }
}

/// Removes a socket file that no server listens on. The caller holds the lock, so no server is about to listen on
/// it.
fn remove_stale(path: &Path, address: &SocketAddrUnix, daemon: &'static str) -> Result<(), DoorError> {
    let os = |action| failed(path, action);
    let kind = match fs::lstat(path) {
        Ok(stat) => FileType::from_raw_mode(stat.st_mode),
        Err(Errno::NOENT) => return Ok(()),
        Err(source) => return Err(os("examine the socket")(source)),
    };
    if kind != FileType::Socket {
        return Err(DoorError::NotASocket { path: path.to_path_buf() });
    }
    let probe = socket(SocketFlags::NONBLOCK).map_err(os("create a Unix SEQPACKET socket"))?;
    match net::connect(&probe, address) {
        Err(Errno::CONNREFUSED) => fs::unlink(path).map_err(os("remove the stale socket")),
        // A socket of another type belongs to another program. It refuses ours by type, though it has a listener.
        Ok(()) | Err(Errno::AGAIN | Errno::PROTOTYPE) => Err(DoorError::InUse { path: path.to_path_buf(), daemon }),
        Err(Errno::ACCESS | Errno::PERM) => Err(DoorError::PermissionDenied { path: path.to_path_buf() }),
        Err(source) => Err(os("check whether a process listens on the socket")(source)),
    }
}
