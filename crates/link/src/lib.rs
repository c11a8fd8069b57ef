//! Protocol between an operator's machine and the robot's. Never does IO, never reads a clock, never allocates, blocks or
//! panics.
//!
//! Persons and the operator's requests go up. Status and feedback come down. Both ends send datagrams ([`Head`]) that may
//! be lost, come late, come twice or come in another order:
//!
//! - The newest counts. A datagram that is not newer than the last one of its kind is refused. Nothing is sent twice. A
//!   request carries counters, so an edge whose datagram is lost arrives with the next one.
//! - Every age is judged on the robot's clock ([`Clock`]). An origin is placed at the earliest time it can have been, so an
//!   age is never under-estimated. What is older than 100 ms is refused.
//! - The robot's end draws a session number for every connection of an operator ([`RobotEnd`]). A silence of 200 ms ends the
//!   session. A new session engages nothing: an enable counts only if it is pressed within the session.
//! - The emergency stop is the exception. It counts from any session, at any age, with any clock.

#![forbid(clippy::disallowed_macros, clippy::disallowed_methods, clippy::disallowed_types)]

mod clock;
mod codec;
mod exchange;
mod operator_end;
mod robot_end;

pub use clock::{Clock, Sample};
pub use codec::{
    ANSWER_BYTES, Answer, Echo, FRAME_BYTES_MAX, Frame, HEAD_BYTES, Head, Kind, PERSON_BYTES, PROTOCOL, Payload,
    Verdict, person_bytes,
};
pub use operator_end::{Down, LinkState, OperatorEnd};
pub use robot_end::{OPERATORS_MAX, Received, RobotEnd, SILENCE_NS, Sent, UNCERTAINTY_MAX_NS};

messages::named! {
    /// The reason why a datagram was refused.
    #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
    pub enum Refusal {
        /// It is shorter or longer than its kind and its joints need.
        Length => "of a wrong length",
        /// It does not begin as a frame of this protocol.
        Magic => "of another protocol",
        /// Its version is another one.
        Version => "of another version",
        /// Its kind is unknown, or one that only the other end receives.
        Kind => "of an unknown kind",
        /// A reserved field is not zero, or a field has a value that its message does not know.
        Value => "with an unknown value",
        /// It belongs to no session, or to another one than the present.
        Session => "of another session",
        /// It is not newer than the last one of its kind.
        Order => "older than the last one, or repeated",
        /// It is older than 100 ms.
        Old => "older than 100 ms",
        /// The clocks are not synchronised.
        Clock => "with a clock that is not synchronised",
        /// The sender's clock has jumped.
        Jump => "from a clock that has jumped",
        /// There are more datagrams than the rate.
        Rate => "above the rate",
        /// Another program of this operator has a session.
        Busy => "from a second program of this operator",
        /// Its echo names a frame that was not sent.
        Echo => "with an echo of nothing that was sent",
    }
}

/// Counts of refused datagrams, by reason.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Refused([u64; Refusal::ALL.len()]);

impl Refused {
    /// Counts one.
    pub(crate) fn count(&mut self, refusal: Refusal) {
        if let Some(count) = self.0.get_mut(refusal as usize) {
            *count = count.saturating_add(1);
        }
    }

    /// Returns the number that was refused for this reason.
    pub fn count_of(&self, refusal: Refusal) -> u64 {
        self.0.get(refusal as usize).copied().unwrap_or_default()
    }

    /// Returns the number of all.
    pub fn total(&self) -> u64 {
        self.0.iter().fold(0, |sum, count| sum.saturating_add(*count))
    }
}

/// The reason why a person cannot be sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Unsendable {
    /// Too many joints are filled.
    #[error("joint_count = {0}: a frame has at most {max} joints", max = messages::RAW_JOINTS_MAX)]
    Joints(u32),
    /// A flag is unknown.
    #[error("flags = {0:#x}: a bit of it is no raw_flag")]
    Flags(u32),
    /// The link has no session yet.
    #[error("the robot has not answered yet, or the link is interrupted")]
    NoSession,
}
