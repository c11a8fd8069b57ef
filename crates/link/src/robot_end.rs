//! The robot's end: sessions of operators, and what of their datagrams may go on to the daemon.

use crate::codec::{Answer, Echo, FRAME_BYTES_MAX, Frame, Head, Kind, Payload, Verdict};
use crate::exchange::Exchange;
use crate::{Refusal, Refused};
use messages::{
    Bucket, EDGES_MAX, HOLDS_CLUTCH, Header, Layout, OPERATOR_VERSION, OperatorRequest, RawSkeleton, Service, Stamp,
};

/// Operators at once: as many as the skeleton socket has places.
pub const OPERATORS_MAX: usize = 8;
/// Silence of an operator that ends the session, ns: ten heartbeats, as `operator` counts a forgotten client. `control`
/// withdraws the enable after 100 ms already.
pub const SILENCE_NS: u64 = 200_000_000;
/// Uncertainty of the clocks from which nothing is engaged, ns. Assumption: a fifth of the age that is accepted.
pub const UNCERTAINTY_MAX_NS: u64 = 20_000_000;
/// Age that is accepted, ns: the one from which a person is stale.
const AGE_MAX_NS: u64 = Service::Skeleton.row().stale_after_ms as u64 * 1_000_000;
/// Ends of an operator whose emergency stops are remembered.
const CLIENTS_KEPT: usize = 4;

/// Use of an accepted datagram.
#[derive(Clone, Copy, Debug, PartialEq)]
#[expect(clippy::large_enum_variant, reason = "no allocation in a tick")]
pub enum Sent {
    /// A session begins: connect to the operator socket again, and answer.
    Began,
    /// Send this request on the connection of this session.
    Request(OperatorRequest),
    /// Publish this person. Its `session_nonce` is the one of the client at the operator's machine.
    Person(RawSkeleton),
}

/// Result of a datagram.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Received {
    /// The operator pressed the emergency stop. A request of `outcome` carries it, too.
    pub stop: bool,
    /// Use of the datagram, or the reason for refusing it.
    pub outcome: Result<Sent, Refusal>,
}

/// A session.
#[derive(Clone, Copy, Debug)]
struct Session {
    nonce: u64,
    /// Time of its last accepted request.
    heard: Stamp,
    /// True once a datagram carried the session's number.
    used: bool,
    /// Jumps of the operator's clock that are dealt with.
    jumps: u64,
    /// Counters of the operator's last request.
    seen: OperatorRequest,
    /// The last request that went on.
    relayed: OperatorRequest,
}

/// State of one operator.
#[derive(Clone, Copy, Debug, Default)]
struct Seat {
    client: u64,
    session: Option<Session>,
    exchange: Exchange,
    buckets: [Bucket; 2],
    refused: Refused,
    /// The newest datagram of a second program of this operator.
    rival: Option<(u64, Echo)>,
    /// An operator's end, its emergency stops that were heard, and those of them that `control` has.
    stops: [(u64, u32, u32); CLIENTS_KEPT],
    next_stop: usize,
}

/// State of the robot's end. The place of each operator is chosen by the caller, who knows their names.
#[derive(Clone, Debug, Default)]
pub struct RobotEnd {
    /// Set by the caller: an emergency stop has not reached `control` yet. No answer says that it was heard.
    pub stop_waits: bool,
    /// Set by the caller: `control` sends no status.
    pub daemon_gone: bool,
    /// Set by the caller: another client than this operator's holds the lease of `ingest`.
    pub led_by_other: [bool; OPERATORS_MAX],
    seats: [Seat; OPERATORS_MAX],
}

impl RobotEnd {
    /// Takes a datagram of the operator at place `at`. `draw` draws the number of a new session, which is never zero.
    pub fn receive(&mut self, at: usize, bytes: &[u8], now: Stamp, draw: impl FnOnce() -> u64) -> Received {
        let Some(seat) = self.seats.get_mut(at) else {
            return Received { stop: false, outcome: Err(Refusal::Session) };
        };
        let mut stop = false;
        let outcome = seat.receive(bytes, now, draw, &mut stop);
        if let Err(refusal) = outcome {
            seat.refused.count(refusal);
        }
        Received { stop, outcome }
    }

    /// Ends the sessions whose operators are silent. Returns their places: close their connections.
    pub fn tick(&mut self, now: Stamp) -> [bool; OPERATORS_MAX] {
        self.seats.each_mut().map(|seat| {
            let silent = seat.session.is_some_and(|session| now.since(session.heard) > SILENCE_NS);
            if silent {
                seat.session = None;
            }
            silent
        })
    }

    /// Ends a session, because its connection to the daemon is lost.
    pub fn end(&mut self, at: usize) {
        if let Some(seat) = self.seats.get_mut(at) {
            seat.session = None;
        }
    }

    /// Writes the answer for the operator at place `at`. Returns its length. `None` if there is no such operator.
    pub fn answer(&mut self, at: usize, now: Stamp, out: &mut [u8; FRAME_BYTES_MAX]) -> Option<usize> {
        let answer = self.answer_of(at, now)?;
        let stop_waits = self.stop_waits;
        self.seats.get_mut(at)?.encode(Payload::Answer(answer), stop_waits, now, out)
    }

    /// Writes the answer for a second program of the operator at place `at`, if there is one.
    pub fn answer_rival(&mut self, at: usize, now: Stamp, out: &mut [u8; FRAME_BYTES_MAX]) -> Option<usize> {
        let (gone, stop_waits) = (self.daemon_gone, self.stop_waits);
        let seat = self.seats.get_mut(at)?;
        let (client, echo) = seat.rival.take()?;
        let payload = Payload::Answer(Answer { verdict: Verdict::Busy, ..seat.state(now, gone) });
        let stops_heard = seat.stops_heard(client, stop_waits);
        let head = Head { stops_heard, echo, ..seat.exchange.head(Kind::Answer, 0, client, now) };
        Frame { head, payload }.encode(out).ok()
    }

    /// Writes a status or a feedback for the operator at place `at`. Returns its length. `None` without a session.
    pub fn send(&mut self, at: usize, payload: Payload, now: Stamp, out: &mut [u8; FRAME_BYTES_MAX]) -> Option<usize> {
        let seat = self.seats.get_mut(at).filter(|seat| seat.session.is_some())?;
        seat.encode(payload, self.stop_waits, now, out)
    }

    /// Returns the state of the operator at place `at`. `None` if none was ever there.
    pub fn state(&self, at: usize, now: Stamp) -> Option<Answer> {
        self.seats.get(at).filter(|seat| seat.client != 0 || seat.refused.total() > 0)?;
        self.answer_of(at, now)
    }

    /// Returns the datagrams of the operator at place `at` that were refused, by reason.
    pub fn refused(&self, at: usize) -> Refused {
        self.seats.get(at).map(|seat| seat.refused).unwrap_or_default()
    }

    /// Returns the time on the way to the operator at place `at` and back, ns.
    pub fn round_trip_ns(&self, at: usize) -> Option<u64> {
        self.seats.get(at)?.exchange.clock.round_trip_ns()
    }

    fn answer_of(&self, at: usize, now: Stamp) -> Option<Answer> {
        let answer = self.seats.get(at)?.state(now, self.daemon_gone);
        Some(Answer { led_by_other: *self.led_by_other.get(at)?, ..answer })
    }
}

impl Seat {
    fn receive(
        &mut self,
        bytes: &[u8],
        now: Stamp,
        draw: impl FnOnce() -> u64,
        stop: &mut bool,
    ) -> Result<Sent, Refusal> {
        let head = Head::get(bytes)?;
        let bucket = match head.kind {
            Kind::Operator => &mut self.buckets[0],
            Kind::Person => &mut self.buckets[1],
            Kind::Answer | Kind::Status | Kind::Feedback => return Err(Refusal::Kind),
        };
        // What comes again must not cost the operator a token. Its emergency stop counted the first time.
        if head.client == self.client && self.exchange.is_repeated(&head) {
            return Err(Refusal::Order);
        }
        let within_rate = bucket.admit(now);
        if !within_rate && head.kind == Kind::Person {
            return Err(Refusal::Rate);
        }
        match Frame::get(bytes)?.payload {
            Payload::Operator(request) => {
                // The emergency stop has no rate.
                *stop = self.is_new_stop(&head, request.estop_count);
                match head.session {
                    _ if !within_rate => Err(Refusal::Rate),
                    0 => self.begin(&head, &request, now, draw),
                    _ => self.relay(&head, &request, now, *stop),
                }
            }
            Payload::Person(person) => self.place(&head, person, now),
            Payload::Answer(_) | Payload::Status(_) | Payload::Feedback(_) => Err(Refusal::Kind),
        }
    }

    /// Returns true if the operator's end has pressed the emergency stop since its last request. The count begins with the
    /// start of that end and not with the session. What an earlier start of this end has heard does not count again.
    fn is_new_stop(&mut self, head: &Head, count: u32) -> bool {
        let known = self.stops.iter().position(|(known, ..)| *known == head.client);
        let place = known.unwrap_or(self.next_stop);
        let Some(stop) = self.stops.get_mut(place) else { return count > 0 };
        if known.is_none() {
            *stop = (head.client, head.stops_heard, head.stops_heard);
            self.next_stop = (place + 1) % CLIENTS_KEPT;
        }
        let edges = count.wrapping_sub(stop.1);
        let newer = edges != 0 && edges <= u32::MAX / 2;
        if newer {
            stop.1 = count;
        }
        newer
    }

    /// Returns the emergency stops of an operator's end that `control` has.
    fn stops_heard(&mut self, client: u64, stop_waits: bool) -> u32 {
        if !stop_waits {
            self.stops.iter_mut().for_each(|(_, count, relayed)| *relayed = *count);
        }
        self.stops.iter().find(|(known, ..)| *known == client).map_or(0, |(.., relayed)| *relayed)
    }

    /// Begins a session. What was pressed before counts for nothing in it.
    fn begin(
        &mut self,
        head: &Head,
        request: &OperatorRequest,
        now: Stamp,
        draw: impl FnOnce() -> u64,
    ) -> Result<Sent, Refusal> {
        let live = self.session.is_some_and(|session| now.since(session.heard) <= SILENCE_NS);
        if head.client != self.client {
            if live {
                self.rival = Some((head.client, Echo { sequence: head.sequence, sent: head.sent, received: now }));
                return Err(Refusal::Busy);
            }
            // The clock of another program may be that of another machine.
            (self.client, self.exchange) = (head.client, Exchange::default());
        }
        match self.exchange.receive(head, now) {
            Ok(()) => {}
            // The new session does not need that exchange.
            Err(refusal @ (Refusal::Jump | Refusal::Echo)) => self.refused.count(refusal),
            Err(refusal) => return Err(refusal),
        }
        if self.is_old(head, now) {
            return Err(Refusal::Old);
        }
        // The operator's end asks until the answer arrives. That is one session.
        let repeated = self.session.filter(|session| live && !session.used);
        let nonce = repeated.map_or_else(draw, |session| session.nonce);
        let relayed = OperatorRequest { version: OPERATOR_VERSION, ..OperatorRequest::ZERO };
        self.session = Some(Session {
            nonce,
            heard: now,
            used: false,
            jumps: self.exchange.clock.jumps(),
            seen: *request,
            relayed,
        });
        Ok(Sent::Began)
    }

    /// Returns an error unless the datagram belongs to the present session and is newer than the last one of its kind.
    fn check(&mut self, head: &Head, now: Stamp) -> Result<(), Refusal> {
        let present = self.session.as_mut().filter(|_| head.client == self.client);
        let Some(session) = present.filter(|session| session.nonce == head.session) else {
            if self.session.is_none() {
                // The answer "no session" has to name a datagram of the one who hears it.
                if self.client != head.client {
                    (self.client, self.exchange) = (head.client, Exchange::default());
                }
                let _ = self.exchange.receive(head, now);
            }
            return Err(Refusal::Session);
        };
        session.used = true;
        self.exchange.receive(head, now)
    }

    /// Returns true if the datagram may have been sent too long ago. Without a clock that is not known.
    fn is_old(&self, head: &Head, now: Stamp) -> bool {
        self.exchange.clock.earliest(head.sent, now).is_some_and(|earliest| now.since(earliest) > AGE_MAX_NS)
    }

    fn relay(&mut self, head: &Head, request: &OperatorRequest, now: Stamp, stop: bool) -> Result<Sent, Refusal> {
        let checked = self.check(head, now);
        let clock = &self.exchange.clock;
        let (uncertainty_ns, jumps) = (clock.uncertainty_ns(now), clock.jumps());
        let is_old = self.is_old(head, now);
        let Some(session) = &mut self.session else { return Err(Refusal::Session) };
        if let Err(refusal) = checked {
            if matches!(refusal, Refusal::Jump | Refusal::Echo) {
                session.seen.enable_count = request.enable_count;
            }
            return Err(refusal);
        }
        if is_old {
            // What was pressed then must not come later. A release and a reset come with the next request.
            session.seen.enable_count = request.enable_count;
            return Err(Refusal::Old);
        }
        let (seen, last) = (&session.seen, &session.relayed);
        let edges = |new: u32, old: u32| Some(new.wrapping_sub(old)).filter(|&edges| edges <= EDGES_MAX);
        let (Some(enables), Some(releases), Some(resets), Some(payloads)) = (
            edges(request.enable_count, seen.enable_count),
            edges(request.release_count, seen.release_count),
            edges(request.reset_count, seen.reset_count),
            edges(request.payload_count, seen.payload_count),
        ) else {
            return Err(Refusal::Value);
        };
        let is_certain = uncertainty_ns.is_some_and(|uncertainty_ns| uncertainty_ns <= UNCERTAINTY_MAX_NS);
        // The clocks may be synchronised again before the next request. A jump is a release all the same.
        let may_engage = is_certain && session.jumps == jumps;
        // An enable that may not count is consumed: it has to be pressed again.
        let (level, enables) =
            if may_engage { (request.enable_level, enables) } else { (request.enable_level & HOLDS_CLUTCH, 0) };
        let relayed = OperatorRequest {
            enable_level: level,
            enable_count: last.enable_count.wrapping_add(enables),
            release_count: last.release_count.wrapping_add(releases),
            reset_count: last.reset_count.wrapping_add(resets),
            estop_count: last.estop_count.wrapping_add(u32::from(stop)),
            payload_count: last.payload_count.wrapping_add(payloads),
            sequence: last.sequence.wrapping_add(1),
            version: OPERATOR_VERSION,
            ..*request
        };
        (session.seen, session.relayed, session.heard, session.jumps) = (*request, relayed, now, jumps);
        Ok(Sent::Request(relayed))
    }

    /// Places a person on this machine's clock, at the earliest time it can have been.
    fn place(&mut self, head: &Head, person: RawSkeleton, now: Stamp) -> Result<Sent, Refusal> {
        self.check(head, now)?;
        if person.header.origin > head.sent {
            // It was seen before the clock was set back. How long before is not known.
            return Err(Refusal::Jump);
        }
        let origin = self.exchange.clock.earliest(person.header.origin, now).ok_or(Refusal::Clock)?;
        if now.since(origin) > AGE_MAX_NS {
            return Err(Refusal::Old);
        }
        let header = Header { origin: origin.min(now), stamp: now, ..person.header };
        Ok(Sent::Person(RawSkeleton { header, ..person }))
    }

    fn state(&self, now: Stamp, daemon_gone: bool) -> Answer {
        let uncertainty_ns = self.exchange.clock.uncertainty_ns(now);
        let verdict = match (self.session, uncertainty_ns) {
            _ if daemon_gone => Verdict::NoDaemon,
            (None, _) => Verdict::NoSession,
            (_, None) => Verdict::Unsynchronised,
            (_, Some(ns)) if ns > UNCERTAINTY_MAX_NS => Verdict::Uncertain,
            _ => Verdict::Ready,
        };
        let loss = &self.exchange.loss;
        Answer {
            verdict,
            led_by_other: false,
            uncertainty_ns: uncertainty_ns.unwrap_or(u64::MAX),
            received: loss.received,
            lost: loss.lost(),
            refused: self.refused.total(),
        }
    }

    fn encode(
        &mut self,
        payload: Payload,
        stop_waits: bool,
        now: Stamp,
        out: &mut [u8; FRAME_BYTES_MAX],
    ) -> Option<usize> {
        if self.client == 0 {
            return None;
        }
        let stops_heard = self.stops_heard(self.client, stop_waits);
        let session = self.session.map_or(0, |session| session.nonce);
        let head = Head { stops_heard, ..self.exchange.head(payload.kind(), session, self.client, now) };
        Frame { head, payload }.encode(out).ok()
    }
}
