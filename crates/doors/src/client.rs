//! The client's end of the skeleton socket.

use crate::error::DoorError;
use crate::frame::encode_frame;
use crate::listener::connect;
use crate::protocol::{FEEDBACK_BYTES, Hello, REQUESTS_FEEDBACK, Reply, ReplyPacket};
use messages::{Feedback, Message, RawSkeleton};
use rustix::io::Errno;
use rustix::net::{self, RecvFlags, SendFlags};
use std::os::fd::OwnedFd;
use std::path::{Path, PathBuf};

/// Longest wait for the reply to a hello: a hundred rounds of `ingest`.
const TIMEOUT_MS: u64 = 1000;
/// Replies that may wait in the socket. The kernel queues fewer than this.
const ANSWERS_MAX: usize = 1024;
const DAEMON: &str = "teleopd ingest";

/// A client's session with `ingest`.
#[derive(Debug)]
pub struct Client {
    path: PathBuf,
    socket: OwnedFd,
    session_nonce: u64,
    last_reply: Reply,
    feedback: Option<Box<Feedback>>,
}

enum Packet {
    Reply(ReplyPacket),
    Feedback(Box<Feedback>),
}

impl Client {
    /// Connects to the socket of `ingest` at `path` and sends a hello. Waits at most 1 s for the reply.
    pub fn attach(path: impl AsRef<Path>) -> Result<Self, DoorError> {
        Self::attach_as(path, Hello::OURS)
    }

    /// As [`Client::attach`], and the daemon sends its feedback to this client.
    pub fn attach_with_feedback(path: impl AsRef<Path>) -> Result<Self, DoorError> {
        Self::attach_as(path, Hello { requests: REQUESTS_FEEDBACK, ..Hello::OURS })
    }

    fn attach_as(path: impl AsRef<Path>, hello: Hello) -> Result<Self, DoorError> {
        let path = path.as_ref().to_path_buf();
        let socket = connect(&path, DAEMON, TIMEOUT_MS)?;
        let mut client = Self { path, socket, session_nonce: 0, last_reply: Reply::Granted, feedback: None };
        match net::send(&client.socket, &hello.encode(), SendFlags::NOSIGNAL) {
            // The daemon has refused already. Its reply says why.
            Ok(_) | Err(Errno::PIPE | Errno::CONNRESET) => {}
            Err(errno) => return Err(client.failed("say hello", errno)),
        }
        // The first packet is the reply to the hello.
        let Some(Packet::Reply(answer)) = client.receive(RecvFlags::empty())? else {
            let path = client.path.clone();
            return Err(DoorError::Timeout { path, daemon: DAEMON, timeout_ms: TIMEOUT_MS });
        };
        (client.session_nonce, client.last_reply) = (answer.session_nonce, answer.word);
        Ok(client)
    }

    /// Sends `frame` in this session, without waiting. While the daemon does not read, frames are lost.
    pub fn publish(&mut self, frame: &RawSkeleton) -> Result<(), DoorError> {
        self.listen()?;
        let bytes = encode_frame(&RawSkeleton { session_nonce: self.session_nonce, ..*frame });
        match net::send(&self.socket, &bytes, SendFlags::NOSIGNAL | SendFlags::DONTWAIT) {
            Ok(_) => Ok(()),
            Err(errno @ (Errno::PIPE | Errno::CONNRESET)) => {
                self.listen()?;
                Err(self.failed("send a frame", errno))
            }
            Err(errno) => Err(self.failed("send a frame", errno)),
        }
    }

    /// Takes the replies that have arrived. A refusal is an error.
    pub fn listen(&mut self) -> Result<(), DoorError> {
        for _ in 0..ANSWERS_MAX {
            match self.receive(RecvFlags::DONTWAIT)? {
                Some(Packet::Reply(answer)) => self.last_reply = answer.word,
                Some(Packet::Feedback(feedback)) => self.feedback = Some(feedback),
                None => break,
            }
        }
        Ok(())
    }

    /// Returns the daemon's last reply.
    pub fn last_reply(&self) -> Reply {
        self.last_reply
    }

    /// Returns the newest feedback that [`Client::listen`] or [`Client::publish`] received. `None` before the first.
    pub fn feedback(&self) -> Option<&Feedback> {
        self.feedback.as_deref()
    }

    /// Returns the number of this session, which every frame carries.
    pub fn session_nonce(&self) -> u64 {
        self.session_nonce
    }

    /// Receives one packet. Returns `None` if none comes in time. A refusal is an error.
    fn receive(&self, flags: RecvFlags) -> Result<Option<Packet>, DoorError> {
        let mut bytes = [0; FEEDBACK_BYTES + 1];
        let mut resets = 0;
        loop {
            match net::recv(&self.socket, &mut bytes[..], flags) {
                Ok((length, _)) => {
                    if let Some(feedback) = Feedback::from_le_bytes(&bytes[..length]) {
                        return Ok(Some(Packet::Feedback(Box::new(feedback))));
                    }
                    let closed = || DoorError::Closed { path: self.path.clone(), daemon: DAEMON };
                    let answer = ReplyPacket::decode(&bytes[..length]).ok_or_else(closed)?;
                    if answer.word.is_refusal() {
                        return Err(DoorError::Refused { path: self.path.clone(), word: answer.word });
                    }
                    return Ok(Some(Packet::Reply(answer)));
                }
                Err(Errno::INTR) => {}
                Err(Errno::AGAIN) => return Ok(None),
                // The kernel first reports that the daemon left packets unread. Then it delivers the daemon's
                // last reply.
                Err(Errno::CONNRESET) if resets == 0 => resets = 1,
                Err(errno) => return Err(self.failed("receive a reply", errno)),
            }
        }
    }

    fn failed(&self, action: &'static str, errno: Errno) -> DoorError {
        let path = self.path.clone();
        match errno {
            Errno::AGAIN => DoorError::Timeout { path, daemon: DAEMON, timeout_ms: TIMEOUT_MS },
            Errno::PIPE | Errno::CONNRESET | Errno::NOTCONN => DoorError::Closed { path, daemon: DAEMON },
            source => DoorError::Os { path, action, source },
        }
    }
}
