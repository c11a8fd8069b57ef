//! The operator's end: builds the datagrams, and judges those of the robot.

use crate::codec::{Answer, FRAME_BYTES_MAX, Frame, Head, Kind, Payload};
use crate::exchange::Exchange;
use crate::robot_end::SILENCE_NS;
use crate::{Refusal, Refused, Unsendable};
use messages::{Feedback, OperatorRequest, RawSkeleton, Stamp, Status, comes_after};

/// Content of an accepted datagram.
#[derive(Clone, Copy, Debug, PartialEq)]
#[expect(clippy::large_enum_variant, reason = "no allocation in a tick")]
pub enum Down {
    /// State of the connection.
    Answer(Answer),
    /// Status of `control`.
    Status(Status),
    /// Feedback for the clients.
    Feedback(Feedback),
}

/// State of the link, as the operator's end sees it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LinkState {
    /// The robot's last answer, if it is not older than 1 s.
    pub answer: Option<Answer>,
    /// Time on the way to the robot and back, ns.
    pub round_trip_ns: Option<u64>,
    /// Datagrams of the robot that arrived.
    pub received: u64,
    /// Datagrams of the robot that did not arrive.
    pub lost: u64,
    /// Datagrams that were refused here.
    pub refused: Refused,
}

/// Age from which the robot's last answer says nothing, ns: ten answers.
const ANSWER_AGE_MAX_NS: u64 = 1_000_000_000;

/// State of the operator's end.
#[derive(Clone, Debug, Default)]
pub struct OperatorEnd {
    client: u64,
    session: u64,
    /// Number of the last datagram before the present session.
    asked: u64,
    heard: Stamp,
    answer: Option<(Answer, Stamp)>,
    /// Emergency stops of this end that the robot's end has heard.
    stops_heard: u32,
    exchange: Exchange,
    refused: Refused,
}

impl OperatorEnd {
    /// Creates the state without a session. `client` is drawn for this start and not zero.
    pub fn new(client: u64) -> Self {
        Self { client: client.max(1), ..Self::default() }
    }

    /// Writes a heartbeat and returns its length. Without a session it asks for one. Call it at 50 Hz.
    pub fn heartbeat(&mut self, request: &OperatorRequest, now: Stamp, out: &mut [u8; FRAME_BYTES_MAX]) -> usize {
        if self.session != 0 && now.since(self.heard) > SILENCE_NS {
            (self.session, self.asked) = (0, self.exchange.sequence());
        }
        self.encode(Payload::Operator(*request), now, out).unwrap_or_default()
    }

    /// Writes a person and returns the length.
    ///
    /// # Errors
    /// Returns the reason why it cannot be sent.
    pub fn person(
        &mut self,
        person: &RawSkeleton,
        now: Stamp,
        out: &mut [u8; FRAME_BYTES_MAX],
    ) -> Result<usize, Unsendable> {
        if self.session == 0 {
            return Err(Unsendable::NoSession);
        }
        self.encode(Payload::Person(*person), now, out)
    }

    fn encode(&mut self, payload: Payload, now: Stamp, out: &mut [u8; FRAME_BYTES_MAX]) -> Result<usize, Unsendable> {
        let head = self.exchange.head(payload.kind(), self.session, self.client, now);
        let head = Head { stops_heard: self.stops_heard, ..head };
        Frame { head, payload }.encode(out)
    }

    /// Takes a datagram of the robot. `now` may not be before its arrival: that looks like a jump of the clock.
    ///
    /// # Errors
    /// Returns the reason for refusing it.
    pub fn receive(&mut self, bytes: &[u8], now: Stamp) -> Result<Down, Refusal> {
        self.judge(bytes, now).inspect_err(|refusal| self.refused.count(*refusal))
    }

    fn judge(&mut self, bytes: &[u8], now: Stamp) -> Result<Down, Refusal> {
        let head = Head::get(bytes)?;
        if matches!(head.kind, Kind::Operator | Kind::Person) {
            return Err(Refusal::Kind);
        }
        let payload = Frame::get(bytes)?.payload;
        if head.client != self.client {
            return Err(Refusal::Session);
        }
        if !self.exchange.sent(&head.echo) {
            return Err(Refusal::Echo);
        }
        // The robot's end counts them over all sessions, and never back.
        if comes_after(u64::from(head.stops_heard), u64::from(self.stops_heard)) {
            self.stops_heard = head.stops_heard;
        }
        if head.session != self.session {
            // Only an answer to what was sent since the last change changes it again.
            if !comes_after(head.echo.sequence, self.asked) {
                return Err(Refusal::Session);
            }
            (self.session, self.asked) = (head.session, self.exchange.sequence());
            self.exchange.restart();
        }
        match self.exchange.receive(&head, now) {
            Ok(()) | Err(Refusal::Jump) => {}
            Err(refusal) => return Err(refusal),
        }
        self.heard = now;
        Ok(match payload {
            Payload::Answer(answer) => {
                self.answer = Some((answer, now));
                Down::Answer(answer)
            }
            Payload::Status(status) => Down::Status(status),
            Payload::Feedback(feedback) => Down::Feedback(feedback),
            Payload::Operator(_) | Payload::Person(_) => return Err(Refusal::Kind),
        })
    }

    /// Returns the emergency stops of this end that `control` at the robot has.
    pub fn stops_heard(&self) -> u32 {
        self.stops_heard
    }

    /// Returns true while there is a session.
    pub fn is_linked(&self, now: Stamp) -> bool {
        self.session != 0 && now.since(self.heard) <= SILENCE_NS
    }

    /// Returns the state of the link.
    pub fn link(&self, now: Stamp) -> LinkState {
        let answer = self.answer.filter(|(_, at)| now.since(*at) <= ANSWER_AGE_MAX_NS);
        LinkState {
            answer: answer.map(|(answer, _)| answer),
            round_trip_ns: self.exchange.clock.round_trip_ns(),
            received: self.exchange.loss.received,
            lost: self.exchange.loss.lost(),
            refused: self.refused,
        }
    }
}
