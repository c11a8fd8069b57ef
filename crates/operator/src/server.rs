//! The end of the socket in `control`.

use crate::codec::{self, REQUEST_BYTES};
use crate::error::OperatorError;
use crate::merge::{CLIENTS_MAX, LEASE_NS, Merge, OperatorView, Seat};
use messages::{Stamp, Status};
use rustix::fs::{self, FileType, FlockOperation, Mode, OFlags};
use rustix::io::Errno;
use rustix::net::{self, AddressFamily, RecvFlags, SendFlags, SocketAddrUnix, SocketFlags, SocketType};
use std::os::fd::OwnedFd;
use std::path::{Path, PathBuf};

/// Requests that one connection may have taken in one poll. At 50 Hz and a poll of 1 ms there is at most one; the rest
/// waits in the kernel.
const REQUESTS_MAX: usize = 8;

/// Age of the last request at which a connection may be put out if a new one finds no place: ten heartbeats.
const IDLE_NS: u64 = 200_000_000;

/// The server. Bound once; polling neither blocks nor allocates.
pub struct Server {
    path: PathBuf,
    socket: OwnedFd,
    /// Held as long as the server lives: of two that start at once, one finds it locked.
    _lock: OwnedFd,
    clients: [Option<(OwnedFd, Seat)>; CLIENTS_MAX],
    merge: Merge,
    lease_ns: u64,
}

impl Server {
    /// Listens on `path`, mode 0660. A socket file on which nobody answers is replaced, anything else is left alone. A
    /// file `path`.lock beside it keeps two servers from replacing each other.
    pub fn bind(path: impl AsRef<Path>) -> Result<Self, OperatorError> {
        let path = path.as_ref().to_path_buf();
        let address = SocketAddrUnix::new(&path).map_err(|_| OperatorError::PathTooLong { path: path.clone() })?;
        let lock = lock(&path)?;
        remove_stale(&path, &address)?;
        let os = |action| {
            let path = path.clone();
            move |source| OperatorError::Os { path, action, source }
        };
        let flags = SocketFlags::CLOEXEC | SocketFlags::NONBLOCK;
        let socket = net::socket_with(AddressFamily::UNIX, SocketType::SEQPACKET, flags, None)
            .map_err(os("make a Unix SEQPACKET socket"))?;
        net::bind(&socket, &address).map_err(|errno| match errno {
            Errno::ACCESS | Errno::PERM => OperatorError::PermissionDenied { path: path.clone() },
            source => OperatorError::Os { path: path.clone(), action: "bind the socket", source },
        })?;
        // Before `listen`, so that nobody connects under the mode that the umask gave.
        fs::chmod(&path, Mode::RUSR | Mode::WUSR | Mode::RGRP | Mode::WGRP)
            .map_err(os("set the mode of the socket"))?;
        net::listen(&socket, CLIENTS_MAX as i32).map_err(os("listen on the socket"))?;
        Ok(Self {
            path,
            socket,
            _lock: lock,
            clients: [const { None }; CLIENTS_MAX],
            merge: Merge::default(),
            lease_ns: LEASE_NS,
        })
    }

    /// Withdraws the enable after `lease_ns` without a heartbeat of its holder instead of after `LEASE_NS`: for machines
    /// without real-time rights.
    pub fn with_lease_ns(mut self, lease_ns: u64) -> Self {
        self.lease_ns = lease_ns;
        self
    }

    /// Takes new connections and all requests that have arrived, answers each with `status`, and returns what they add up
    /// to. `now` is the time of CLOCK_MONOTONIC.
    pub fn poll(&mut self, now: Stamp, status: &Status) -> OperatorView {
        self.merge.begin(now, self.lease_ns);
        self.accept(now);
        let mut reply = *status;
        reply.operators = self.connections();
        let reply = codec::encode_status(&reply);
        for index in 0..CLIENTS_MAX {
            if !self.serve(index, now, &reply) {
                self.clients[index] = None;
                self.merge.gone(index);
            }
        }
        self.merge.view.connections = self.connections();
        self.merge.view
    }

    fn connections(&self) -> u32 {
        self.clients.iter().flatten().count() as u32
    }

    /// Takes what waits at the door; at most one full house per poll.
    fn accept(&mut self, now: Stamp) {
        for _ in 0..CLIENTS_MAX {
            let Ok(socket) = net::accept_with(&self.socket, SocketFlags::CLOEXEC | SocketFlags::NONBLOCK) else {
                return;
            };
            match self.free_place(now) {
                Some(index) => self.clients[index] = Some((socket, Seat::new(now))),
                None => self.merge.view.connections_refused += 1,
            }
        }
    }

    /// A free place, if need be that of the connection that has been silent longest: sixteen forgotten clients must not
    /// keep an emergency stop out.
    fn free_place(&mut self, now: Stamp) -> Option<usize> {
        if let Some(index) = self.clients.iter().position(Option::is_none) {
            return Some(index);
        }
        let silent = |index: usize| self.clients[index].as_ref().map_or(0, |(_, seat)| now.since(seat.heard));
        (0..CLIENTS_MAX)
            .filter(|&index| self.merge.holder != Some(index) && silent(index) > IDLE_NS)
            .max_by_key(|&index| silent(index))
    }

    /// Takes the requests of one connection; `false` if it is gone or makes no sense.
    fn serve(&mut self, index: usize, now: Stamp, reply: &[u8]) -> bool {
        let Some((socket, seat)) = &mut self.clients[index] else {
            return true;
        };
        for _ in 0..REQUESTS_MAX {
            // One byte more than a request, so that a longer one shows.
            let mut bytes = [0; REQUEST_BYTES + 1];
            match net::recv(&*socket, &mut bytes[..], RecvFlags::DONTWAIT) {
                Ok((0, _)) => return false,
                Ok((length, _)) => {
                    let Some(request) = codec::decode_request(&bytes[..length]) else {
                        self.merge.view.requests_refused += 1;
                        return false;
                    };
                    if !self.merge.request(index, seat, now, &request) {
                        return false;
                    }
                }
                // The kernel reports a client that left replies unread before it delivers that client's last requests,
                // and one of them may be an emergency stop.
                Err(Errno::INTR | Errno::CONNRESET) => continue,
                Err(Errno::AGAIN) => return true,
                Err(_) => return false,
            }
            // A client that does not read loses replies and nothing else; one that is gone shows when it has been emptied.
            let _ = net::send(&*socket, reply, SendFlags::DONTWAIT | SendFlags::NOSIGNAL);
        }
        true
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        // While the lock is still held; if it fails, the next server finds a stale file and replaces it.
        let _ = fs::unlink(&self.path);
    }
}

/// Locks `path`.lock.
fn lock(path: &Path) -> Result<OwnedFd, OperatorError> {
    let mut name = path.as_os_str().to_owned();
    name.push(".lock");
    let flags = OFlags::CREATE | OFlags::RDWR | OFlags::CLOEXEC | OFlags::NOFOLLOW;
    let file = fs::open(name.as_os_str(), flags, Mode::RUSR | Mode::WUSR).map_err(|errno| {
        let directory = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new(".")).to_path_buf();
        match errno {
            Errno::NOENT | Errno::NOTDIR => OperatorError::NoDirectory { path: directory },
            Errno::ACCESS | Errno::PERM | Errno::ROFS => OperatorError::PermissionDenied { path: directory },
            source => OperatorError::Os { path: name.clone().into(), action: "open the lock file", source },
        }
    })?;
    match fs::flock(&file, FlockOperation::NonBlockingLockExclusive) {
        Ok(()) => Ok(file),
        Err(Errno::WOULDBLOCK) => Err(OperatorError::InUse { path: path.to_path_buf() }),
        Err(source) => Err(OperatorError::Os { path: name.into(), action: "lock the lock file", source }),
    }
}

/// Removes a socket on which nobody answers. The lock is held: no server is just about to listen on it.
fn remove_stale(path: &Path, address: &SocketAddrUnix) -> Result<(), OperatorError> {
    let os = |action| move |source| OperatorError::Os { path: path.to_path_buf(), action, source };
    let kind = match fs::lstat(path) {
        Ok(stat) => FileType::from_raw_mode(stat.st_mode),
        Err(Errno::NOENT) => return Ok(()),
        Err(source) => return Err(os("examine the socket")(source)),
    };
    if kind != FileType::Socket {
        return Err(OperatorError::NotASocket { path: path.to_path_buf() });
    }
    let flags = SocketFlags::CLOEXEC | SocketFlags::NONBLOCK;
    let probe = net::socket_with(AddressFamily::UNIX, SocketType::SEQPACKET, flags, None)
        .map_err(os("make a Unix SEQPACKET socket"))?;
    match net::connect(&probe, address) {
        Err(Errno::CONNREFUSED) => fs::unlink(path).map_err(os("remove the stale socket")),
        // Of another type: somebody else's socket, which refuses ours by type and not for want of a listener.
        Ok(()) | Err(Errno::AGAIN | Errno::PROTOTYPE) => Err(OperatorError::InUse { path: path.to_path_buf() }),
        Err(Errno::ACCESS | Errno::PERM) => Err(OperatorError::PermissionDenied { path: path.to_path_buf() }),
        Err(source) => Err(os("ask whether somebody answers on the socket")(source)),
    }
}
