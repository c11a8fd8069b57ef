//! The operator and the person at another machine. Both ends of a link carry what they send over wires that lose, delay,
//! reorder, repeat and break, and between clocks that drift and jump.

use bus::{FaultPlan, Faulty, Latest, Publish};
use link::{FRAME_BYTES_MAX, OperatorEnd, Payload, Received, RobotEnd, SILENCE_NS, Sent};
use messages::{
    HOLDS_CLUTCH, HOLDS_ENABLE, HOLDS_RECOVERY, LEAVES_OUT, Layout, OPERATOR_VERSION, OperatorRequest, RawSkeleton,
    Stamp, Status, TICK_HZ,
};
use operator::{Connection, LEASE_NS, Merge, OperatorCounts};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

const MS: u64 = 1_000_000;
/// Ticks between two heartbeats, and between two statuses: 50 Hz, as the bridge sends them.
const HEARTBEAT: u64 = TICK_HZ / 50;
/// Ticks between two answers: 10 Hz, as the bridge sends them.
const ANSWER: u64 = TICK_HZ / 10;
/// Oldest person that may arrive, ns.
const AGE_MAX_NS: u64 = 100 * MS;
/// Oldest press that may engage, ns: the longest silence of a session, and the time until the next heartbeat and tick.
const PRESS_AGE_MAX_NS: u64 = SILENCE_NS + 21 * MS;
/// Longest time for which the wires stay as they are, ticks. It is longer than the clock keeps its best exchange. Half of the
/// times are below a sixteenth of it.
const STAYS: u64 = 12 * TICK_HZ;
/// Largest drift of the operator's clock against the robot's, ns per ms: 500 ppm, more than crystals have.
const DRIFT_NS_PER_MS: i64 = 500;
/// Largest jump of the operator's clock, ns. It jumps in one of `JUMPS_IN` changes.
const JUMP_NS: i64 = 10_000 * MS as i64;
const JUMPS_IN: u32 = 6;
/// One of this many changes makes all wires good.
const GOOD_IN: u32 = 3;
/// Time within which a stop and a release arrive over good wires, ns: a new session takes two ways and two heartbeats. It is an
/// assumption for all that a session may need.
const ARRIVES_NS: u64 = 500 * MS;

/// A datagram on a wire.
#[derive(Clone, Copy)]
struct Packet {
    length: usize,
    bytes: [u8; FRAME_BYTES_MAX],
    /// True time at which it was sent.
    sent: Stamp,
    /// Time at which its person was seen, as the client says, on the robot's clock.
    origin: Stamp,
}

#[derive(Clone)]
pub struct Remote {
    operator: OperatorEnd,
    robot: RobotEnd,
    /// Heartbeats and persons up, answers and statuses down.
    wires: [Faulty<Packet>; 4],
    /// The server that the robot's end is connected to.
    merge: Merge,
    connection: Connection,
    request: OperatorRequest,
    /// The operator's counters before this look.
    seen: OperatorCounts,
    /// True time of the newest press.
    pressed: Stamp,
    presses: u64,
    /// True time of a press of the emergency stop that has not arrived yet, and the stops that have.
    stop: Option<Stamp>,
    stops: u64,
    /// True time at which the operator last held the enable.
    held: Stamp,
    /// True time at which the wires were last bad or the operator silent.
    hindered: Stamp,
    /// The operator's clock minus the robot's, ns, and its drift.
    offset_ns: i64,
    drift_ns_per_ms: i64,
    changes: u64,
    are_bad: bool,
    rng: Pcg64Mcg,
    pub(crate) broken: Option<(&'static str, String)>,
}

impl Remote {
    pub(crate) fn new(seed: u64) -> Self {
        let wire = |line| Faulty::new(FaultPlan::default(), seed.wrapping_mul(4) + line);
        let mut rng = Pcg64Mcg::seed_from_u64(seed ^ 0x11_4e57);
        Self {
            operator: OperatorEnd::new(77),
            robot: RobotEnd::default(),
            wires: [wire(0), wire(1), wire(2), wire(3)],
            merge: Merge::default(),
            connection: Connection::new(Stamp::NONE),
            request: OperatorRequest { version: OPERATOR_VERSION, ..OperatorRequest::ZERO },
            seen: OperatorCounts::default(),
            pressed: Stamp::NONE,
            presses: 0,
            stop: None,
            stops: 0,
            held: Stamp::NONE,
            hindered: Stamp::NONE,
            offset_ns: rng.random_range(0..1_000_000_000_000),
            drift_ns_per_ms: rng.random_range(-DRIFT_NS_PER_MS..=DRIFT_NS_PER_MS),
            changes: 0,
            are_bad: false,
            rng,
            broken: None,
        }
    }

    /// Takes other random numbers from here on.
    pub(crate) fn reseed(&mut self, seed: u64) {
        (self.rng, self.changes) = (Pcg64Mcg::seed_from_u64(seed ^ 0x11_4e57), 0);
        for (line, wire) in self.wires.iter_mut().enumerate() {
            wire.reseed(seed.wrapping_mul(4) + line as u64);
        }
    }

    /// `control` starts again: the robot's end loses its connection.
    pub(crate) fn reconnect(&mut self) {
        (self.merge, self.seen, self.presses) = (Merge::default(), OperatorCounts::default(), 0);
        (self.stop, self.stops) = (None, 0);
        self.robot.end(0);
    }

    /// Changes the wires at tick `k` once they have been as they are for long enough. Wires of quiet times are good.
    pub(crate) fn change(&mut self, k: u64, now: Stamp, quiet: bool) {
        if quiet {
            return self.wires.iter_mut().for_each(|wire| wire.set_plan(FaultPlan::default()));
        }
        if self.are_bad {
            self.hindered = now;
        }
        if k < self.changes {
            return;
        }
        self.changes = k + (STAYS as f64 * self.rng.random::<f64>().powi(4)) as u64;
        let plans = [bad(&mut self.rng), bad(&mut self.rng)];
        self.are_bad = self.rng.random_range(0..GOOD_IN) != 0;
        let plans = if self.are_bad { plans } else { [FaultPlan::default(); 2] };
        // In half of the cases both ways are alike.
        let down = plans[usize::from(self.rng.random::<bool>())];
        for (line, wire) in self.wires.iter_mut().enumerate() {
            wire.set_plan(if line < 2 { plans[0] } else { down });
        }
        if self.rng.random_range(0..JUMPS_IN) == 0 {
            self.offset_ns += self.rng.random_range(-JUMP_NS..=JUMP_NS);
        }
    }

    /// The operator's clock at `now` of the robot's.
    fn theirs(&self, now: Stamp) -> Stamp {
        let drift = (now.0 / MS) as i64 * self.drift_ns_per_ms;
        now_plus(now, self.offset_ns.saturating_add(drift))
    }

    fn send(&mut self, line: usize, packet: &Packet) {
        if packet.length > 0 {
            // A wire takes everything.
            let _ = self.wires[line].publish(packet);
        }
    }

    /// Takes the persons that the client sends in this tick, and returns those that arrive in their place.
    pub(crate) fn carry(&mut self, k: u64, now: Stamp, frames: &mut Vec<RawSkeleton>) {
        let mut out = [0; FRAME_BYTES_MAX];
        let theirs = self.theirs(now);
        let ahead = theirs.0.cast_signed() - now.0.cast_signed();
        for mut person in frames.drain(..) {
            let origin = person.header.origin;
            person.header.origin = now_plus(origin, ahead);
            person.header.stamp = now_plus(person.header.stamp, ahead);
            if let Ok(length) = self.operator.person(&person, theirs, &mut out) {
                self.send(1, &Packet { length, bytes: out, sent: now, origin });
            }
        }
        self.wires.iter_mut().for_each(|wire| wire.advance(now));
        for line in 0..2 {
            if let Some(packet) = self.wires[line].latest() {
                let taken = self.robot.receive(0, &packet.bytes[..packet.length], now, || now.0.max(1));
                self.accept(taken, &packet, now, frames);
            }
        }
        if self.robot.tick(now)[0] {
            self.merge.gone(0);
        }
        if k.is_multiple_of(ANSWER) {
            self.answer(now);
        }
        if k.is_multiple_of(HEARTBEAT)
            && let Some(length) = self.robot.send(0, Payload::Status(Status::ZERO), now, &mut out)
        {
            self.send(3, &Packet { length, bytes: out, sent: now, origin: now });
        }
        for line in 2..4 {
            if let Some(packet) = self.wires[line].latest() {
                let _ = self.operator.receive(&packet.bytes[..packet.length], theirs);
            }
        }
    }

    fn answer(&mut self, now: Stamp) {
        let mut out = [0; FRAME_BYTES_MAX];
        if let Some(length) = self.robot.answer(0, now, &mut out) {
            self.send(2, &Packet { length, bytes: out, sent: now, origin: now });
        }
    }

    /// Uses what arrived at the robot's end.
    fn accept(&mut self, taken: Received, packet: &Packet, now: Stamp, frames: &mut Vec<RawSkeleton>) {
        match taken.outcome {
            Ok(Sent::Began) => {
                // The robot's end opens a new connection.
                self.merge.gone(0);
                self.connection = Connection::new(now);
                self.answer(now);
            }
            Ok(Sent::Request(request)) => {
                self.merge.request(0, 0, &mut self.connection, now, &request);
            }
            Ok(Sent::Person(person)) => {
                if now.since(packet.sent) > AGE_MAX_NS {
                    let age_ms = now.since(packet.sent) / MS;
                    self.broken = Some(("person over the link", format!("it was sent {age_ms} ms ago")));
                }
                if person.header.origin > packet.origin.max(Stamp(1)) {
                    let new_us = person.header.origin.since(packet.origin) / 1_000;
                    self.broken = Some(("origin over the link", format!("{new_us} us too new")));
                }
                frames.push(person);
            }
            Err(_) => {}
        }
        if taken.stop && !matches!(taken.outcome, Ok(Sent::Request(_))) {
            self.merge.stop_alone(0, &OperatorRequest { estop_count: 1, ..OperatorRequest::ZERO });
        }
    }

    /// Sends the operator's heartbeat, if he speaks and it is due. Returns the view that arrived.
    pub(crate) fn view(&mut self, k: u64, now: Stamp, speaks: bool, view: &OperatorCounts) -> OperatorCounts {
        self.press(now, view);
        if speaks && k.is_multiple_of(HEARTBEAT) {
            self.request.sequence += 1;
            let mut out = [0; FRAME_BYTES_MAX];
            let length = self.operator.heartbeat(&self.request, self.theirs(now), &mut out);
            self.send(0, &Packet { length, bytes: out, sent: now, origin: now });
        }
        self.merge.begin(now, LEASE_NS);
        self.merge.counts.connections = 1;
        let arrived = self.merge.counts;
        self.judge(now, speaks, view, &arrived);
        let engaged = arrived.enable_edges + arrived.recover_edges;
        if engaged > self.presses {
            self.presses = engaged;
            let age_ns = now.since(self.pressed);
            if self.pressed == Stamp::NONE || age_ns > PRESS_AGE_MAX_NS {
                self.broken = Some(("press over the link", format!("it was made {} ms ago", age_ns / MS)));
            }
        }
        arrived
    }

    /// Judges that what stops the robot arrives in time over good wires.
    fn judge(&mut self, now: Stamp, speaks: bool, view: &OperatorCounts, arrived: &OperatorCounts) {
        if arrived.estop_edges > self.stops {
            (self.stops, self.stop) = (arrived.estop_edges, None);
        }
        if !speaks {
            self.hindered = now;
        }
        if view.held.enable_level {
            self.held = now;
        }
        let hindered = self.hindered;
        let is_late = |since: Stamp| now.since(since.max(hindered)) > ARRIVES_NS;
        if self.stop.is_some_and(is_late) {
            self.broken = Some(("stop over the link", "it does not arrive".to_owned()));
        }
        if arrived.held.enable_level && is_late(self.held) {
            self.broken = Some(("release over the link", "it does not arrive".to_owned()));
        }
    }

    /// Turns what the operator does into the request of the next heartbeat. A counter of a new operator begins at zero.
    fn press(&mut self, now: Stamp, view: &OperatorCounts) {
        let since = |new: u64, old: u64| (if new >= old { new - old } else { new }) as u32;
        let seen = &self.seen;
        let presses = since(view.enable_edges, seen.enable_edges) + since(view.recover_edges, seen.recover_edges);
        if presses > 0 {
            self.pressed = now;
        }
        if view.estop_edges > seen.estop_edges {
            self.stop = Some(now);
        }
        let request = &mut self.request;
        request.enable_count = request.enable_count.wrapping_add(presses);
        request.release_count = request.release_count.wrapping_add(since(view.release_edges, seen.release_edges));
        request.reset_count = request.reset_count.wrapping_add(since(view.reset_edges, seen.reset_edges));
        request.estop_count = request.estop_count.wrapping_add(since(view.estop_edges, seen.estop_edges));
        let holds = [
            (view.held.enable_level, HOLDS_ENABLE),
            (view.held.recover_level, HOLDS_RECOVERY),
            (view.held.clutch_level, HOLDS_CLUTCH),
            (view.held.enable_level && view.held.left_out == [true, false], LEAVES_OUT[0]),
            (view.held.enable_level && view.held.left_out == [false, true], LEAVES_OUT[1]),
        ];
        request.enable_level = holds.into_iter().filter(|(is, _)| *is).map(|(_, bit)| bit).sum();
        self.seen = *view;
    }
}

/// One of the ways in which a wire is bad, or none.
fn bad(rng: &mut Pcg64Mcg) -> FaultPlan {
    let delay = |delay_ms: u64, jitter_ms: u64| FaultPlan {
        delay_min_ns: delay_ms * MS,
        delay_max_ns: (delay_ms + jitter_ms) * MS,
        ..FaultPlan::default()
    };
    match rng.random_range(0..9) {
        0 => FaultPlan { drop: 0.05, ..delay(5, 2) },
        1 => FaultPlan { drop: 0.2, ..delay(5, 10) },
        2 => delay(rng.random_range(10..50), 0),
        3 => delay(rng.random_range(50..200), 5),
        4 => FaultPlan { reorder: 0.2, reorder_ns: 30 * MS, ..delay(5, 30) },
        5 => FaultPlan { duplicate: 0.3, ..delay(5, 10) },
        6 => FaultPlan { drop: 1.0, ..FaultPlan::default() },
        _ => delay(1, 1),
    }
}

fn now_plus(now: Stamp, ns: i64) -> Stamp {
    Stamp(now.0.saturating_add_signed(ns))
}
