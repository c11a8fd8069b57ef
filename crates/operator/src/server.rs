//! The end of the socket in `control`.

use crate::client::DAEMON;
use crate::codec::{self, REQUEST_BYTES};
use crate::error::OperatorError;
use crate::locks::ResetRule;
use crate::merge::{CLIENTS_MAX, Connection, LEASE_NS, Merge, OperatorCounts};
use doors::{Admission, Listener};
use messages::{Stamp, Status};
use rt::Peer;
use rustix::io::Errno;
use rustix::net::{self, RecvFlags, SendFlags};
use std::os::fd::OwnedFd;
use std::path::Path;

/// Requests that one poll takes from one connection. At 50 Hz and a poll of 1 ms there is at most one. The rest
/// waits in the kernel.
const REQUESTS_MAX: usize = 8;

/// Age of its last request from which a connection counts as forgotten: ten heartbeats.
const IDLE_NS: u64 = 200_000_000;

/// Silence after which a connection ends that waits for the answer to a stop: a client repeats its request after 200 ms.
const WAITS_NS: u64 = 500_000_000;

/// Log records that are kept until they are taken. Further actions are only counted.
const RECORDS_MAX: usize = 32;

messages::named! {
    /// An action of one process at the socket, for the log.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    #[allow(missing_docs, reason = "the names say it")]
    pub enum AuditEvent {
        Connected => "connected",
        /// It was disconnected.
        Forbidden => "refused: only the daemon's user and members of the socket's group may connect",
        Enabled => "pressed the enable",
        Recovers => "pressed the recovery",
        EmergencyStop => "pressed the emergency stop",
        Reset => "pressed reset",
        PayloadLeft => "set the left hand's payload",
        PayloadRight => "set the right hand's payload",
        ResetRefused =>
            "pressed reset, refused: another user pressed the emergency stop and must reset it first",
    }
}

/// An action and the process that did it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AuditRecord {
    /// The action.
    pub event: AuditEvent,
    /// The process that connected.
    pub peer: Peer,
}

/// The server. It is bound once. Polling neither blocks nor allocates.
pub struct Server {
    listener: Listener,
    clients: [Option<(OwnedFd, Peer, Connection)>; CLIENTS_MAX],
    merge: Merge,
    lease_ns: u64,
    records: [Option<AuditRecord>; RECORDS_MAX],
}

impl Server {
    /// Listens on `path`, mode 0660, with the group of the process. A socket file without a listener is replaced.
    /// Any other file is left alone. A file `path`.lock beside it keeps two servers from replacing each other.
    pub fn bind(path: impl AsRef<Path>) -> Result<Self, OperatorError> {
        Self::bind_for(path, None)
    }

    /// Does the same as `bind`, for the members of `group`.
    pub fn bind_for(path: impl AsRef<Path>, group: Option<u32>) -> Result<Self, OperatorError> {
        Ok(Self {
            listener: Listener::bind(path.as_ref(), DAEMON, group, CLIENTS_MAX)?,
            clients: [const { None }; CLIENTS_MAX],
            merge: Merge::default(),
            lease_ns: LEASE_NS,
            records: [None; RECORDS_MAX],
        })
    }

    /// Withdraws the enable after `lease_ns` without a heartbeat of its holder, instead of after `LEASE_NS`. This
    /// is for machines without real-time rights.
    pub fn with_lease_ns(mut self, lease_ns: u64) -> Self {
        self.lease_ns = lease_ns;
        self
    }

    /// Sets the rule for resets.
    pub fn with_reset_rule(mut self, rule: ResetRule) -> Self {
        self.merge.rule = rule;
        self
    }

    /// Takes new connections and all requests that have arrived, replies to each with `status`, and returns the
    /// merged commands. `now` is the time of CLOCK_MONOTONIC.
    pub fn poll(&mut self, now: Stamp, status: &Status) -> OperatorCounts {
        self.merge.begin(now, self.lease_ns);
        if self.connections() as usize == CLIENTS_MAX {
            // Connections that may lose their place are served first.
            self.serve_all(now, &codec::encode_status(&self.reply(status)));
        }
        self.accept(now, &self.reply(status));
        self.serve_all(now, &codec::encode_status(&self.reply(status)));
        self.merge.counts.connections = self.connections();
        self.merge.counts
    }

    /// Takes requests while nobody answers. Of the counts only the emergency stops may be used. Every connection ends, but for
    /// those that pressed a stop and hold nothing: each of their next requests gets `reply`, which shows the stop. `begins` is
    /// true in the first such round. It ends all connections.
    pub fn poll_stops(&mut self, now: Stamp, reply: Option<&Status>, begins: bool) -> OperatorCounts {
        self.merge.begin(now, self.lease_ns);
        let reply = reply.filter(|_| !begins).map(|reply| codec::encode_status(&self.reply(reply)));
        for index in 0..CLIENTS_MAX {
            let waited = self.clients[index].as_ref().is_some_and(|(_, _, seat)| seat.has_pressed_stop());
            let stays = self.serve(index, now, reply.as_ref().filter(|_| waited).map_or(&[], |reply| &reply[..]));
            // Nothing is held here, even if it was pressed.
            self.merge.gone(index);
            let Some((.., seat)) = &self.clients[index] else { continue };
            let waits = (seat.is_new() || seat.has_pressed_stop()) && now.since(seat.heard) < WAITS_NS;
            if begins || !stays || !waits {
                self.clients[index] = None;
            }
        }
        for _ in 0..CLIENTS_MAX {
            match self.listener.accept() {
                None => break,
                Some(Admission::Forbidden(..)) => self.merge.counts.connections_refused += 1,
                Some(Admission::Admitted(socket, peer)) => match self.clients.iter().position(Option::is_none) {
                    Some(index) => self.clients[index] = Some((socket, peer, Connection::new(now))),
                    None => self.turn_away(&socket, peer, &[]),
                },
            }
        }
        self.merge.counts.connections = self.connections();
        self.merge.counts
    }

    /// Returns the status completed with the data of the socket itself.
    fn reply(&self, status: &Status) -> Status {
        let OperatorCounts { reset_first_by, resets_refused, .. } = self.merge.counts;
        let resets_refused = u32::try_from(resets_refused).unwrap_or(u32::MAX);
        Status { operators: self.connections(), reset_first_by, resets_refused, ..*status }
    }

    fn serve_all(&mut self, now: Stamp, reply: &[u8]) {
        for index in 0..CLIENTS_MAX {
            if !self.serve(index, now, reply) {
                self.clients[index] = None;
                self.merge.gone(index);
            }
        }
    }

    /// Hands out the log records since the last call.
    pub fn drain_records(&mut self, use_record: impl FnMut(AuditRecord)) {
        self.records.iter_mut().filter_map(Option::take).for_each(use_record);
    }

    fn record(&mut self, event: AuditEvent, peer: Peer) {
        if let Some(free) = self.records.iter_mut().find(|record| record.is_none()) {
            *free = Some(AuditRecord { event, peer });
        }
    }

    fn connections(&self) -> u32 {
        self.clients.iter().flatten().count() as u32
    }

    /// Accepts waiting connections, at most `CLIENTS_MAX` per poll. It reads requests before it drops a
    /// connection. So an emergency stop among them counts, also from a client that loses its place or gets none.
    fn accept(&mut self, now: Stamp, reply: &Status) {
        let mut may_displace = true;
        for _ in 0..CLIENTS_MAX {
            match self.listener.accept() {
                None => return,
                Some(Admission::Forbidden(_, peer)) => {
                    self.merge.counts.connections_refused += 1;
                    self.record(AuditEvent::Forbidden, peer);
                }
                Some(Admission::Admitted(socket, peer)) => match self.place(now, peer, &mut may_displace) {
                    Some(index) => {
                        if self.clients[index].is_some() {
                            self.serve(index, now, &codec::encode_status(reply));
                            self.merge.gone(index);
                        }
                        self.clients[index] = Some((socket, peer, Connection::new(now)));
                        self.record(AuditEvent::Connected, peer);
                    }
                    None => self.turn_away(&socket, peer, &codec::encode_status(reply)),
                },
            }
        }
    }

    /// Takes only an emergency stop from a client that gets no place.
    fn turn_away(&mut self, socket: &OwnedFd, peer: Peer, reply: &[u8]) {
        self.merge.counts.connections_refused += 1;
        let mut bytes = [0; REQUEST_BYTES + 1];
        for _ in 0..REQUESTS_MAX {
            let Ok((length, _)) = net::recv(socket, &mut bytes[..], RecvFlags::DONTWAIT) else { return };
            if codec::decode_request(&bytes[..length]).is_some_and(|request| self.merge.stop_alone(peer.uid, &request))
            {
                self.record(AuditEvent::EmergencyStop, peer);
                answer(socket, reply);
                return;
            }
        }
    }

    /// Returns a place for a connection of `peer`: a free one, or the place of the idlest connection of the
    /// process with the most places. The new connection counts for its own process. So every process has one
    /// place before any has a second, and a process that connects without end takes places from itself. The
    /// holder keeps its place. If no process has two places, at most one live connection loses its place per
    /// poll. So a crowd cannot displace a new client before it is served.
    fn place(&self, now: Stamp, peer: Peer, may_displace: &mut bool) -> Option<usize> {
        if let Some(index) = self.clients.iter().position(Option::is_none) {
            return Some(index);
        }
        let (own, most) = (self.places(peer) + 1, (0..CLIENTS_MAX).map(|index| self.places_beside(index)).max()?);
        let loses = |index: usize| match own {
            2.. if own >= most => self.is_of(index, peer),
            _ => self.places_beside(index) == most,
        };
        let silent = |index: usize| self.clients[index].as_ref().map_or(0, |(_, _, seat)| now.since(seat.heard));
        let others = (0..CLIENTS_MAX).filter(|&index| self.merge.holder != Some(index) && loses(index));
        let index = others.max_by_key(|&index| silent(index))?;
        if own < most || silent(index) > IDLE_NS {
            return Some(index);
        }
        std::mem::take(may_displace).then_some(index)
    }

    fn places(&self, peer: Peer) -> usize {
        (0..CLIENTS_MAX).filter(|&index| self.is_of(index, peer)).count()
    }

    fn places_beside(&self, index: usize) -> usize {
        self.clients[index].as_ref().map_or(0, |&(_, peer, _)| self.places(peer))
    }

    fn is_of(&self, index: usize, peer: Peer) -> bool {
        self.clients[index].as_ref().is_some_and(|(_, other, _)| (other.pid, other.uid) == (peer.pid, peer.uid))
    }

    /// Takes the requests of one connection. Returns `false` if it is gone or sent an invalid request.
    fn serve(&mut self, index: usize, now: Stamp, reply: &[u8]) -> bool {
        let Some((_, peer, _)) = self.clients[index] else {
            return true;
        };
        let before = self.merge.counts;
        let stays = self.take_requests(index, now, reply);
        let counts = self.merge.counts;
        for (is, was, event) in [
            (counts.enable_edges, before.enable_edges, AuditEvent::Enabled),
            (counts.recover_edges, before.recover_edges, AuditEvent::Recovers),
            (counts.estop_edges, before.estop_edges, AuditEvent::EmergencyStop),
            (counts.reset_edges, before.reset_edges, AuditEvent::Reset),
            (counts.payload_edges[0], before.payload_edges[0], AuditEvent::PayloadLeft),
            (counts.payload_edges[1], before.payload_edges[1], AuditEvent::PayloadRight),
            (counts.resets_refused, before.resets_refused, AuditEvent::ResetRefused),
        ] {
            if is > was {
                self.record(event, peer);
            }
        }
        stays
    }

    fn take_requests(&mut self, index: usize, now: Stamp, reply: &[u8]) -> bool {
        let Some((socket, peer, seat)) = &mut self.clients[index] else {
            return true;
        };
        for _ in 0..REQUESTS_MAX {
            // One byte more than a request, so that a longer packet is detected.
            let mut bytes = [0; REQUEST_BYTES + 1];
            match net::recv(&*socket, &mut bytes[..], RecvFlags::DONTWAIT) {
                Ok((0, _)) => return false,
                Ok((length, _)) => {
                    let Some(request) = codec::decode_request(&bytes[..length]) else {
                        self.merge.counts.requests_refused += 1;
                        return false;
                    };
                    if !self.merge.request(index, peer.uid, seat, now, &request) {
                        return false;
                    }
                }
                // The kernel first reports that the client left replies unread. Then it delivers the client's
                // last requests, and one of them may be an emergency stop.
                Err(Errno::INTR | Errno::CONNRESET) => continue,
                Err(Errno::AGAIN) => return true,
                Err(_) => return false,
            }
            // A client that does not read loses replies and nothing else. The end of a client shows once its
            // requests are read.
            answer(socket, reply);
        }
        true
    }
}

/// Sends a reply, unless it is empty.
fn answer(socket: &OwnedFd, reply: &[u8]) {
    if !reply.is_empty() {
        let _ = net::send(socket, reply, SendFlags::DONTWAIT | SendFlags::NOSIGNAL);
    }
}
