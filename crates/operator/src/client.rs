//! The end of the socket in `teleopctl`.

use crate::codec::{self, STATUS_BYTES};
use crate::error::OperatorError;
use crate::merge::CLUTCHES;
use messages::{
    HOLDS_CLUTCH, HOLDS_ENABLE, HOLDS_RECOVERY, LEAVES_OUT, Layout, OPERATOR_VERSION, OperatorRequest, PayloadOrder,
    Status, TAKES_OVER, payload_flag,
};
use rustix::io::Errno;
use rustix::net::{self, RecvFlags, SendFlags};
use std::os::fd::OwnedFd;
use std::path::{Path, PathBuf};

/// Longest wait for a reply: ten polls of a server that polls at 50 Hz.
const TIMEOUT_MS: u64 = 200;

/// Late replies that may wait in the socket. The kernel queues fewer than this.
const LATE_REPLIES_MAX: usize = 1024;

/// The process that the socket belongs to.
pub(crate) const DAEMON: &str = "teleopd control";

/// Returns the reason for refusing a reset by this process: another user pressed the emergency stop. Returns
/// `None` if `status` shows no such user.
pub fn reset_refusal(status: &Status) -> Option<String> {
    let own = rustix::process::geteuid().as_raw();
    let uid = status.reset_first_by.checked_sub(1).filter(|&uid| own != 0 && uid != own)?;
    let user = doors::user_name(uid);
    let who = if uid == 0 { "only root" } else { "only this user or root" };
    Some(format!(
        "the emergency stop was pressed by user {user}; {who} may reset it \
         (control.emergency_stop_reset = \"presser\")"
    ))
}

/// A connection to `control`, and the counters of this client's edges.
pub struct Client {
    path: PathBuf,
    socket: OwnedFd,
    request: OperatorRequest,
    timeout_ms: u64,
}

impl Client {
    /// Connects to the socket of `control` at `path`. Waits at most 200 ms for each reply.
    pub fn connect(path: impl AsRef<Path>) -> Result<Self, OperatorError> {
        Self::connect_within(path, TIMEOUT_MS)
    }

    /// Does the same as `connect`, with another time to wait for each reply.
    pub fn connect_within(path: impl AsRef<Path>, timeout_ms: u64) -> Result<Self, OperatorError> {
        let path = path.as_ref().to_path_buf();
        let socket = doors::connect(&path, DAEMON, timeout_ms)?;
        let request = OperatorRequest { version: OPERATOR_VERSION, ..OperatorRequest::ZERO };
        Ok(Self { path, socket, request, timeout_ms })
    }

    /// Presses the enable of both arms with the next heartbeat.
    pub fn enable(&mut self) -> &mut Self {
        self.hold(HOLDS_ENABLE)
    }

    /// Presses the enable with the next heartbeat, without one arm: 0 is the left one, 1 the right one. It stays where it is.
    pub fn enable_without(&mut self, arm: usize) -> &mut Self {
        self.hold(HOLDS_ENABLE | LEAVES_OUT[usize::from(arm != 0)])
    }

    /// Presses the recovery with the next heartbeat.
    pub fn recover(&mut self) -> &mut Self {
        self.hold(HOLDS_RECOVERY)
    }

    fn hold(&mut self, what: u32) -> &mut Self {
        self.request.enable_level = what | self.request.enable_level & CLUTCHES;
        self.request.enable_count = self.request.enable_count.wrapping_add(1);
        self
    }

    /// Releases the enable or the recovery with the next heartbeat. Also withdraws that of another connection.
    pub fn release(&mut self) -> &mut Self {
        self.request.enable_level &= CLUTCHES;
        self.request.release_count = self.request.release_count.wrapping_add(1);
        self
    }

    /// Holds the clutch from the next heartbeat on, or lets go of it. The robot stands while any client holds it.
    pub fn clutch(&mut self, held: bool) -> &mut Self {
        self.request.enable_level = self.request.enable_level & !HOLDS_CLUTCH | if held { HOLDS_CLUTCH } else { 0 };
        self
    }

    /// Lets the person lead the policy's left and right arm from the next heartbeat on, or no longer.
    pub fn take_over(&mut self, arms: [bool; 2]) -> &mut Self {
        let bits = (0..2).filter(|&arm| arms[arm]).fold(0, |bits, arm| bits | TAKES_OVER[arm]);
        self.request.enable_level = self.request.enable_level & !(TAKES_OVER[0] | TAKES_OVER[1]) | bits;
        self
    }

    /// Presses reset with the next heartbeat.
    pub fn reset(&mut self) -> &mut Self {
        self.request.reset_count = self.request.reset_count.wrapping_add(1);
        self
    }

    /// Reports the payload of a hand with the next heartbeat. Hand 0 is the left one, 1 the right one. If it is
    /// called several times before a heartbeat, only the last report is sent.
    pub fn payload(&mut self, hand: usize, order: &PayloadOrder) -> &mut Self {
        let right = if hand == 0 { 0 } else { payload_flag::RIGHT };
        let centre = if order.centre_m.is_some() { payload_flag::CENTRE } else { 0 };
        self.request.payload_flags = right | centre;
        self.request.payload_kg = order.mass_kg;
        self.request.payload_centre_m = order.centre_m.unwrap_or_default();
        self.request.payload_count = self.request.payload_count.wrapping_add(1);
        self
    }

    /// Presses the emergency stop with the next heartbeat.
    pub fn estop(&mut self) -> &mut Self {
        self.request.estop_count = self.request.estop_count.wrapping_add(1);
        self
    }

    /// Sends the state of this client and returns the status of `control`. Call it at 50 Hz while anything is held.
    pub fn heartbeat(&mut self) -> Result<Status, OperatorError> {
        self.request.sequence += 1;
        let request = self.request;
        self.exchange(&request)
    }

    /// Sends a request unchanged and returns the reply.
    pub fn exchange(&mut self, request: &OperatorRequest) -> Result<Status, OperatorError> {
        self.send(request)?;
        loop {
            match self.receive(RecvFlags::empty()) {
                Err(Errno::INTR) => continue,
                Err(errno) => return Err(self.failed("receive a reply", errno)),
                Ok(reply) => return reply,
            }
        }
    }

    /// Sends a request unchanged and waits for no reply. The next call drops it.
    pub fn send(&mut self, request: &OperatorRequest) -> Result<(), OperatorError> {
        self.drop_late_replies()?;
        loop {
            match net::send(&self.socket, &codec::encode_request(request), SendFlags::NOSIGNAL) {
                Ok(_) => return Ok(()),
                Err(Errno::INTR) => continue,
                Err(errno) => return Err(self.failed("send a request", errno)),
            }
        }
    }

    /// Drops replies that came after their exchange had timed out. They do not answer the next request.
    fn drop_late_replies(&mut self) -> Result<(), OperatorError> {
        for _ in 0..LATE_REPLIES_MAX {
            match self.receive(RecvFlags::DONTWAIT) {
                Ok(Ok(_)) => {}
                Ok(Err(error)) => return Err(error),
                Err(Errno::INTR) => {}
                Err(Errno::AGAIN) => return Ok(()),
                Err(errno) => return Err(self.failed("receive a reply", errno)),
            }
        }
        Ok(())
    }

    fn receive(&self, flags: RecvFlags) -> Result<Result<Status, OperatorError>, Errno> {
        // One byte more than a status, so that a longer packet is detected.
        let mut bytes = [0; STATUS_BYTES + 1];
        let (length, _) = net::recv(&self.socket, &mut bytes[..], flags)?;
        let path = || self.path.clone();
        Ok(match (length, codec::decode_status(&bytes[..length])) {
            (_, Some(status)) => Ok(status),
            (0, None) => Err(OperatorError::Closed { path: path() }),
            (bytes, None) => Err(OperatorError::BadReply { path: path(), bytes, expected: STATUS_BYTES }),
        })
    }

    fn failed(&self, action: &'static str, errno: Errno) -> OperatorError {
        let path = self.path.clone();
        match errno {
            Errno::AGAIN => OperatorError::Timeout { path, timeout_ms: self.timeout_ms },
            Errno::PIPE | Errno::CONNRESET | Errno::NOTCONN => OperatorError::Closed { path },
            source => OperatorError::Os { path, action, source },
        }
    }
}
