//! The process at the other end of a Unix socket, as the kernel reports it.
#![allow(unsafe_code)]

use std::io::{Error, ErrorKind, Result};
use std::mem::size_of;
use std::os::fd::{AsRawFd, BorrowedFd};

/// Largest number of supplementary groups of a peer that are searched. Linux allows 65,536 (NGROUPS_MAX), a login
/// has some dozens. If a peer has more, none of them counts.
const GROUPS_MAX: usize = 256;

/// The peer of a Unix socket at the time of its connect(2) (SO_PEERCRED, unix(7)). A process that inherits the
/// descriptor later still counts as that peer.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Peer {
    /// Process, in the numbering of this process's namespace. 0 if the peer is outside of it.
    pub pid: u32,
    /// Effective user.
    pub uid: u32,
    /// Effective group.
    pub gid: u32,
}

impl Peer {
    /// Returns the peer of a connected socket.
    pub fn from_socket(socket: BorrowedFd<'_>) -> Result<Self> {
        let mut found = [libc::ucred { pid: 0, uid: 0, gid: 0 }];
        let bytes = ask(socket, libc::SO_PEERCRED, &mut found)?;
        if bytes != size_of::<libc::ucred>() {
            return Err(Error::from(ErrorKind::InvalidData));
        }
        let [libc::ucred { pid, uid, gid }] = found;
        Ok(Self { pid: u32::try_from(pid).unwrap_or(0), uid, gid })
    }

    /// Returns true if group `gid` is the peer's effective one or one of its supplementary groups (SO_PEERGROUPS).
    pub fn is_member(&self, socket: BorrowedFd<'_>, gid: u32) -> bool {
        let mut groups = [0; GROUPS_MAX];
        let mut supplementary = || {
            let bytes = ask(socket, libc::SO_PEERGROUPS, &mut groups).ok()?;
            groups.get(..bytes / size_of::<libc::gid_t>()).map(|groups| groups.contains(&gid))
        };
        self.gid == gid || supplementary().unwrap_or(false)
    }
}

/// Reads a socket option of variable length. Returns its length in bytes.
fn ask<T: Copy>(socket: BorrowedFd<'_>, option: libc::c_int, into: &mut [T]) -> Result<usize> {
    let mut bytes = size_of_val(into) as libc::socklen_t;
    let place = into.as_mut_ptr().cast::<libc::c_void>();
    // SAFETY: `place` points to `bytes` writable bytes of plain numbers, for which every pattern is valid. The kernel
    // writes no more than `bytes` and returns how many.
    let rc = unsafe { libc::getsockopt(socket.as_raw_fd(), libc::SOL_SOCKET, option, place, &mut bytes) };
    if rc == 0 { Ok(bytes as usize) } else { Err(Error::last_os_error()) }
}
