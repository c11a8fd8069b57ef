//! State of one connection.

use crate::protocol::{Reply, ReplyPacket};
use crate::server::FrameSource;
use messages::{Bucket, Stamp};
use rt::Peer;
use rustix::net::{self, SendFlags};
use std::os::fd::OwnedFd;

/// Interval at which a client gets the reason again while its frames are ignored: twice a second.
const REPEAT_NS: u64 = 500_000_000;

#[derive(Debug)]
pub(crate) struct Connection {
    pub(crate) socket: OwnedFd,
    pub(crate) peer: Peer,
    /// Number of this connection. The server counts them.
    pub(crate) connection: u64,
    /// The session number, or 0 before the hello.
    pub(crate) session_nonce: u64,
    pub(crate) requests_feedback: bool,
    /// It is a policy's, which sends and gets JSON.
    pub(crate) is_policy: bool,
    pub(crate) since: Stamp,
    pub(crate) heard: Stamp,
    pub(crate) bucket: Bucket,
    /// The server does not read the connection before this time.
    pub(crate) muted_until: Stamp,
    /// True if the buffer holds a frame that found no token.
    pub(crate) pending: bool,
    standing: Option<(Reply, Stamp)>,
    quota_sent: Option<Stamp>,
}

impl Connection {
    pub(crate) fn new(socket: OwnedFd, peer: Peer, connection: u64, now: Stamp) -> Self {
        Self {
            socket,
            peer,
            connection,
            session_nonce: 0,
            requests_feedback: false,
            is_policy: false,
            since: now,
            heard: now,
            bucket: Bucket::default(),
            muted_until: Stamp::NONE,
            pending: false,
            standing: None,
            quota_sent: None,
        }
    }

    pub(crate) fn source(&self) -> FrameSource {
        FrameSource { connection: self.connection, peer: self.peer, session_nonce: self.session_nonce }
    }

    /// Sends `word`. A client that does not read loses it.
    pub(crate) fn send(&self, word: Reply) {
        let nonce = if word.is_refusal() { 0 } else { self.session_nonce };
        send(&self.socket, &ReplyPacket::new(word, nonce).encode());
    }

    /// Reports to the client if it holds the lease: when that changes, and repeatedly while it does not.
    pub(crate) fn send_standing(&mut self, now: Stamp, word: Reply) {
        let last = self.standing;
        let again = word == Reply::NotHolder && last.is_some_and(|(_, at)| now.since(at) >= REPEAT_NS);
        if again || last.map(|(word, _)| word) != Some(word) {
            self.send(word);
            self.standing = Some((word, now));
        }
    }

    /// Reports to the client that frames are dropped. Returns `true` if it sent the reply now.
    pub(crate) fn send_quota(&mut self, now: Stamp) -> bool {
        let due = self.quota_sent.is_none_or(|at| now.since(at) >= REPEAT_NS);
        if due {
            self.send(Reply::OverQuota);
            self.quota_sent = Some(now);
        }
        due
    }
}

/// Sends a packet without waiting. A client that does not read loses the packet and nothing else.
pub(crate) fn send(socket: &OwnedFd, packet: &[u8]) {
    let _ = net::send(socket, packet, SendFlags::DONTWAIT | SendFlags::NOSIGNAL);
}
