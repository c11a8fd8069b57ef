//! The end of the skeleton socket in `ingest`.

use crate::connection::{Connection, send};
use crate::error::DoorError;
use crate::frame::{FRAME_BYTES, decode_frame};
use crate::listener::{Admission, Listener};
use crate::nonce::draw_nonce;
use crate::policy::{POLICY_BYTES_MAX, POLICY_HELLO, joints_as_json};
use crate::protocol::{FEEDBACK_BYTES, HELLO_BYTES, Hello, Reply, ReplyPacket};
use messages::{Feedback, Joints, Layout, RawSkeleton, Stamp};
use rt::Peer;
use rustix::io::Errno;
use rustix::net::{self, RecvFlags};
use std::os::fd::{AsFd, BorrowedFd};
use std::path::Path;

/// Largest number of connections at once.
pub const CONNECTIONS_MAX: usize = 8;
/// A connection that has not sent a hello within this time is closed: 1 s.
pub const HELLO_WITHIN_NS: u64 = 1_000_000_000;
/// Age of its last packet from which a connection may be closed for a new one: 5 s. Assumption: no tracker pauses
/// for so long.
pub const IDLE_NS: u64 = 5_000_000_000;

/// Packets of one connection that are read in one round. The kernel queues 11 (net.unix.max_dgram_qlen) unless it
/// is configured otherwise.
const DRAIN_MAX: usize = 32;
/// Notices that are kept until they are taken. Further ones are only counted.
const EVENTS_MAX: usize = 16;
/// Send buffer of a client that gets feedback, or joints: some packets of it, with what the kernel adds to each.
const FEEDBACK_BUFFER_BYTES: usize = 4096;
const JOINTS_BUFFER_BYTES: usize = 16384;
/// One byte more than a frame, so that a longer packet shows.
const BUFFER_BYTES: usize = FRAME_BYTES + 1;
const DAEMON: &str = "teleopd ingest";

/// Source of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FrameSource {
    /// Number of the connection. This server counts them from 1.
    pub connection: u64,
    /// The process that connected.
    pub peer: Peer,
    /// Session number, drawn here for this connection.
    pub session_nonce: u64,
}

/// The lease, as the sender of a frame needs to know it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LeaseState {
    /// Its session holds the lease.
    Holder,
    /// Another session holds the lease.
    NotHolder,
}

/// An event for the log: a client was admitted, refused, or sends too much.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SocketEvent {
    /// The reply that was sent.
    pub word: Reply,
    /// The process that got it.
    pub peer: Peer,
}

/// The server. It is bound once. Polling neither blocks nor allocates.
#[derive(Debug)]
pub struct Server {
    listener: Listener,
    seats: [Option<Connection>; CONNECTIONS_MAX],
    buffers: Box<[[u8; BUFFER_BYTES]; CONNECTIONS_MAX]>,
    /// A policy's message, with a byte more, so that a longer one shows. Empty if no policy is admitted.
    text: Vec<u8>,
    /// The seat whose frame was the last one of the lease holder. It is served first.
    holder: usize,
    connections: u64,
    over_quota: u64,
    replies: [u64; Reply::ALL.len()],
    events: [Option<SocketEvent>; EVENTS_MAX],
}

impl Server {
    /// Listens on `path`, as `Listener::bind`.
    pub fn bind(path: &Path, group: Option<u32>) -> Result<Self, DoorError> {
        let listener = Listener::bind(path, DAEMON, group, CONNECTIONS_MAX)?;
        let buffers = vec![[0; BUFFER_BYTES]; CONNECTIONS_MAX].into_boxed_slice();
        Ok(Self {
            listener,
            seats: [const { None }; CONNECTIONS_MAX],
            buffers: buffers.try_into().expect("as many as there are places"),
            text: Vec::new(),
            holder: 0,
            connections: 0,
            over_quota: 0,
            replies: [0; Reply::ALL.len()],
            events: [None; EVENTS_MAX],
        })
    }

    /// Admits policies too. [`Server::poll_policies`] then reads them.
    #[must_use]
    pub fn with_policies(self) -> Self {
        Self { text: vec![0; POLICY_BYTES_MAX + 1], ..self }
    }

    /// Reads what policies sent. `use_text` gets one message of each connection in a round, so that no skeleton waits for many,
    /// and `None` for one beyond the rate of its connection. It returns an answer, if there is one.
    pub fn poll_policies(
        &mut self,
        now: Stamp,
        mut use_text: impl FnMut(FrameSource, Option<&[u8]>) -> Option<String>,
    ) {
        for place in &mut self.seats {
            let due = place.as_ref().is_some_and(|seat| seat.is_policy && seat.muted_until <= now);
            for _ in 0..if due { DRAIN_MAX } else { 0 } {
                let Some(seat) = place else { break };
                match net::recv(&seat.socket, &mut self.text[..], RecvFlags::DONTWAIT) {
                    Ok((length @ 1.., _)) => {
                        let message = seat.bucket.admit(now).then_some(&self.text[..length]);
                        seat.heard = now;
                        use_text(seat.source(), message)
                            .iter()
                            .for_each(|answer| send(&seat.socket, answer.as_bytes()));
                        if message.is_some() {
                            break;
                        }
                        seat.muted_until = seat.bucket.next();
                    }
                    Err(Errno::INTR | Errno::CONNRESET) => {}
                    Err(Errno::AGAIN) => break,
                    Ok(_) | Err(_) => *place = None,
                }
            }
        }
    }

    /// Sends the joints to every policy, without waiting. `names` are those of the robot's joints.
    pub fn send_joints(&self, joints: &Joints, names: &[String]) {
        let mut text = None;
        for seat in self.seats.iter().flatten().filter(|seat| seat.is_policy) {
            send(&seat.socket, text.get_or_insert_with(|| joints_as_json(joints, names)).as_bytes());
        }
    }

    /// Reads what has arrived, the holder's connection first, and then accepts new connections. It hands the
    /// frames to `use_frame`, at most the rate of each connection. `held` says that a session holds the lease.
    /// `now` is the time of CLOCK_MONOTONIC.
    pub fn poll(&mut self, now: Stamp, held: bool, mut use_frame: impl FnMut(FrameSource, &RawSkeleton) -> LeaseState) {
        let first = self.holder;
        for index in (first..CONNECTIONS_MAX).chain(0..first) {
            if let Err(refusal) = self.serve(index, now, held, &mut use_frame) {
                self.close(index, refusal);
            }
        }
        self.accept(now);
    }

    /// Returns the descriptors to wait for and their number. Poll when one becomes readable. The rest repeats the
    /// first.
    pub fn descriptors(&self, now: Stamp) -> ([BorrowedFd<'_>; CONNECTIONS_MAX + 1], usize) {
        let (mut all, mut count) = ([self.listener.as_fd(); CONNECTIONS_MAX + 1], 1);
        for seat in self.seats.iter().flatten().filter(|seat| seat.muted_until <= now) {
            all[count] = seat.socket.as_fd();
            count += 1;
        }
        (all, count)
    }

    /// Returns the time at which a connection that sent too much is read again, if there is one.
    pub fn next_due(&self, now: Stamp) -> Option<Stamp> {
        self.seats.iter().flatten().map(|seat| seat.muted_until).filter(|&until| until > now).min()
    }

    /// Sends `feedback` to the clients that requested it, without waiting. A client that does not read loses it.
    pub fn feed_back(&self, feedback: &Feedback) {
        let mut bytes = [0; FEEDBACK_BYTES];
        feedback.write_to(&mut bytes);
        for seat in self.seats.iter().flatten().filter(|seat| seat.requests_feedback) {
            send(&seat.socket, &bytes);
        }
    }

    /// Hands out the events for the log since the last call.
    pub fn drain_events(&mut self, use_event: impl FnMut(SocketEvent)) {
        self.events.iter_mut().filter_map(Option::take).for_each(use_event);
    }

    /// Returns the number of frames that were dropped because a connection sent more than the rate.
    pub fn over_quota(&self) -> u64 {
        self.over_quota
    }

    /// Returns how often `word` was sent when a connection began or ended.
    pub fn reply_count(&self, word: Reply) -> u64 {
        self.replies[place(word)]
    }

    /// Returns the number of open connections.
    pub fn connections(&self) -> usize {
        self.seats.iter().flatten().count()
    }

    fn record(&mut self, word: Reply, peer: Peer) {
        self.replies[place(word)] += 1;
        if let Some(free) = self.events.iter_mut().find(|event| event.is_none()) {
            *free = Some(SocketEvent { word, peer });
        }
    }

    fn close(&mut self, index: usize, refusal: Option<Reply>) {
        if let (Some(seat), Some(word)) = (self.seats[index].take(), refusal) {
            seat.send(word);
            self.record(word, seat.peer);
        }
    }

    fn accept(&mut self, now: Stamp) {
        for _ in 0..CONNECTIONS_MAX {
            let (socket, peer, refusal) = match self.listener.accept() {
                None => return,
                Some(Admission::Forbidden(socket, peer)) => (socket, peer, Reply::Forbidden),
                Some(Admission::Admitted(socket, peer)) => match self.free_place(now) {
                    None => (socket, peer, Reply::Full),
                    Some(index) => {
                        self.close(index, Some(Reply::Idle));
                        self.connections += 1;
                        self.seats[index] = Some(Connection::new(socket, peer, self.connections, now));
                        continue;
                    }
                },
            };
            send(&socket, &ReplyPacket::new(refusal, 0).encode());
            self.record(refusal, peer);
        }
    }

    /// Returns a free place. If there is none, it takes the place of the connection that has been silent longest.
    /// So eight forgotten clients cannot keep a person out.
    fn free_place(&self, now: Stamp) -> Option<usize> {
        if let Some(index) = self.seats.iter().position(Option::is_none) {
            return Some(index);
        }
        let silent = |index: usize| self.seats[index].as_ref().map_or(0, |seat| now.since(seat.heard));
        (0..CONNECTIONS_MAX).filter(|&index| silent(index) > IDLE_NS).max_by_key(|&index| silent(index))
    }

    /// Reads one connection. An error ends it, with the reply in the error.
    fn serve(
        &mut self,
        index: usize,
        now: Stamp,
        held: bool,
        use_frame: &mut impl FnMut(FrameSource, &RawSkeleton) -> LeaseState,
    ) -> Result<(), Option<Reply>> {
        match &self.seats[index] {
            Some(seat) if seat.session_nonce == 0 => self.greet(index, now, held),
            Some(seat) if seat.muted_until <= now && !seat.is_policy => self.drain(index, now, use_frame),
            _ => Ok(()),
        }
    }

    /// Waits for the hello and replies to it.
    fn greet(&mut self, index: usize, now: Stamp, held: bool) -> Result<(), Option<Reply>> {
        let Some(seat) = &mut self.seats[index] else { return Ok(()) };
        let mut bytes = [0; HELLO_BYTES + 1];
        match net::recv(&seat.socket, &mut bytes[..], RecvFlags::DONTWAIT) {
            Ok((0, _)) => Err(None),
            Ok((length, _)) if !self.text.is_empty() && bytes[..length] == *POLICY_HELLO => {
                (seat.session_nonce, seat.heard, seat.is_policy) = (draw_nonce(), now, true);
                let _ = net::sockopt::set_socket_send_buffer_size(&seat.socket, JOINTS_BUFFER_BYTES);
                let peer = seat.peer;
                self.record(Reply::Granted, peer);
                Ok(())
            }
            Ok((length, _)) => match Hello::refusal(&bytes[..length]) {
                Some(word) => Err(Some(word)),
                None => {
                    (seat.session_nonce, seat.heard) = (draw_nonce(), now);
                    seat.requests_feedback = Hello::requests_feedback(&bytes[..length]);
                    if seat.requests_feedback {
                        // A client that is late then finds new feedback, and not that of minutes ago.
                        let _ = net::sockopt::set_socket_send_buffer_size(&seat.socket, FEEDBACK_BUFFER_BYTES);
                    }
                    seat.send(if held { Reply::GrantedButHeld } else { Reply::Granted });
                    let peer = seat.peer;
                    self.record(Reply::Granted, peer);
                    Ok(())
                }
            },
            Err(Errno::AGAIN | Errno::INTR) if now.since(seat.since) > HELLO_WITHIN_NS => Err(Some(Reply::Late)),
            Err(Errno::AGAIN | Errno::INTR) => Ok(()),
            Err(_) => Err(None),
        }
    }

    /// Reads what has arrived, at most `DRAIN_MAX` packets. While there are tokens, every frame is used, in
    /// order. The newest of the other frames waits for the next token.
    fn drain(
        &mut self,
        index: usize,
        now: Stamp,
        use_frame: &mut impl FnMut(FrameSource, &RawSkeleton) -> LeaseState,
    ) -> Result<(), Option<Reply>> {
        let Some(seat) = &mut self.seats[index] else { return Ok(()) };
        let buffer = &mut self.buffers[index];
        // After too many frames, the connection is first read empty, so that the token goes to its newest frame.
        let mut hurried = seat.pending;
        for _ in 0..DRAIN_MAX {
            match net::recv(&seat.socket, &mut buffer[..], RecvFlags::DONTWAIT) {
                Ok((0, _)) => return Err(None),
                Ok((FRAME_BYTES, _)) => {}
                Ok(_) => return Err(Some(Reply::WrongSize)),
                Err(Errno::INTR | Errno::CONNRESET) => continue,
                Err(Errno::AGAIN) => break,
                Err(_) => return Err(None),
            }
            self.over_quota += u64::from(seat.pending);
            (seat.heard, seat.pending) = (now, true);
            if !hurried && seat.bucket.admit(now) {
                if deliver(seat, buffer, now, use_frame)? {
                    self.holder = index;
                }
            } else {
                hurried = true;
            }
        }
        if seat.pending {
            if seat.bucket.admit(now) {
                if deliver(seat, buffer, now, use_frame)? {
                    self.holder = index;
                }
            } else {
                seat.muted_until = seat.bucket.next();
                if seat.send_quota(now) {
                    let peer = seat.peer;
                    self.record(Reply::OverQuota, peer);
                }
            }
        }
        Ok(())
    }
}

/// Hands over the frame in the buffer. Returns true if its session holds the lease.
fn deliver(
    seat: &mut Connection,
    buffer: &[u8; BUFFER_BYTES],
    now: Stamp,
    use_frame: &mut impl FnMut(FrameSource, &RawSkeleton) -> LeaseState,
) -> Result<bool, Option<Reply>> {
    seat.pending = false;
    let frame = decode_frame(&buffer[..FRAME_BYTES]).ok_or(Some(Reply::WrongSize))?;
    if frame.session_nonce != seat.session_nonce {
        return Err(Some(Reply::ForgedSession));
    }
    let standing = use_frame(seat.source(), &frame);
    seat.send_standing(now, if standing == LeaseState::Holder { Reply::Holder } else { Reply::NotHolder });
    Ok(standing == LeaseState::Holder)
}

fn place(word: Reply) -> usize {
    Reply::ALL.iter().position(|known| *known == word).unwrap_or_default()
}
