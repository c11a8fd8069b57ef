//! Judges the modes that control announces by the inputs of control, not by its own conclusions.

use crate::oracle::{Person, RESTING, Seen};
use messages::{Fault, Faults, Mode, Response, Stamp, TICK_HZ, Transition};
use safety::engage::OperatorView;

/// Thresholds of the shipped settings, in ticks in which control ran, plus the time that a message may take.
const INPUT_STALE: u64 = TICK_HZ / 10 + 15 + 35;
const TARGET_STALE: u64 = TICK_HZ / 100 + 4;
const STATE_LATE: u64 = 8 + 4;
const OPERATOR_SILENT_NS: u64 = 200_000_000 + 3 * 1_000_000_000 / TICK_HZ;
/// Ticks for which the enable must have been up since control started: 200 ms.
const RELEASED: u64 = TICK_HZ / 5;
/// Silence after which a client counts as gone: one second, less the frame's own time.
const AUTHORITY: u64 = TICK_HZ - 2;
/// How long a reset may stay pending, ticks: 100 ms and a margin.
const RESET_PENDING: u64 = TICK_HZ / 10 + 5;

/// Sources of control's inputs.
#[derive(Clone, Copy, Default)]
struct Upstream {
    retarget: Option<u32>,
    session: Option<u64>,
    driver: Option<u32>,
}

#[derive(Clone, Default)]
pub struct Modes {
    mode: Mode,
    transitions: u32,
    behind: Upstream,
    /// The tick since which a process or client is a new one and the operator has not enabled again.
    stranger_k: Option<u64>,
    since_target: u64,
    since_state: u64,
    since_frame: u64,
    since_row: u64,
    released: u64,
    armed: bool,
    reset_k: u64,
    last_k: u64,
    holder: Option<(u64, u64)>,
    person: Option<Person>,
    /// True while a recovery or a policy, or the stop that ends it, moves the robot.
    recovered: bool,
    /// Faults, and whether the enable was up. During a hold they accumulate from its beginning. Outside a hold
    /// they are those of this tick alone.
    since_hold: (Faults, bool),
    /// Session of the person at the beginning of a takeover.
    taker: u64,
    /// Awake ticks of control since another person was passed on. None once the operator has enabled.
    since_person: Option<u64>,
}

pub fn moves(mode: Mode) -> bool {
    follows(mode) || mode == Mode::Recovering
}

pub fn follows(mode: Mode) -> bool {
    matches!(mode, Mode::Engaging | Mode::Engaged)
}

/// A broken promise, and what was seen.
pub type Broken = (&'static str, String);

impl Modes {
    pub fn check(&mut self, seen: &Seen<'_>) -> Result<(), Broken> {
        self.authority(seen)?;
        if seen.control_restarted {
            let Self { holder, person, last_k, .. } = *self;
            *self = Self { stranger_k: Some(seen.k), holder, person, last_k, ..Self::default() };
        }
        if !seen.accepted.is_empty() {
            self.since_frame = 0;
        }
        let (Some(control), Some(operator)) = (&seen.moment.control, seen.operator) else { return Ok(()) };
        let Some(mode) = Mode::from_u32(control.status.mode) else {
            return Err(("mode", format!("{} is not a mode", control.status.mode)));
        };
        let restarted = self.strangers(seen, &operator);
        if restarted != Faults(control.status.faults).has(Fault::WriterRestarted) {
            let detail = format!("of retarget or the driver: {restarted}, but the status says the opposite");
            return Err(("restart", detail));
        }
        self.observe(seen, &operator);
        self.transition(seen, &operator, mode)?;
        self.stops(seen, &operator, mode)?;
        if follows(mode) && self.stranger_k.is_some() {
            return Err(("new engage", "follows after a restart or for another client without a new enable".into()));
        }
        if follows(mode) && !seen.forged && self.since_person.is_some_and(|ticks| ticks > INPUT_STALE) {
            return Err(("new engage", "follows another person without a new enable".into()));
        }
        let person = seen.moment.target_seen.map_or(self.taker, |target| target.session_nonce);
        if seen.policy.leads == 0 || !seen.is_person_leading() || !follows(self.mode) {
            self.taker = person;
        } else if follows(mode) && person != self.taker {
            return Err(("takeover", "another person leads than the one who took over".into()));
        }
        if moves(mode) && !moves(self.mode) && !self.armed {
            return Err(("stuck enable", "moves, but the enable was never released".into()));
        }
        (self.mode, self.last_k) = (mode, seen.k);
        Ok(())
    }

    /// Only one client holds the lease. Another one gets it only after enough silence of the first, with the
    /// robot at rest. A recovery, the stop that ends it, and forged targets move the robot without a client. So
    /// the rest condition does not apply to them.
    fn authority(&mut self, seen: &Seen<'_>) -> Result<(), Broken> {
        if seen.ingest_restarted {
            (self.holder, self.person) = (None, None);
        }
        let moving = seen.moment.robot.is_some_and(|robot| robot.v.iter().any(|v| v.abs() > RESTING));
        let otherwise = self.mode == Mode::Recovering || seen.policy.leads != 0;
        self.recovered = otherwise || self.recovered && moving && !follows(self.mode);
        let moved_otherwise = seen.forged || self.recovered;
        for &person in seen.accepted {
            let session = person.session;
            if let Some((holder, k)) = self.holder
                && holder != session
                && seen.k < k + AUTHORITY
            {
                return Err(("authority", format!("session {session:x} {} ticks after {holder:x}", seen.k - k)));
            }
            let another_client = self.holder.is_some_and(|(holder, _)| holder != session);
            if let Some(robot) = seen.moment.robot.filter(|_| another_client && !moved_otherwise)
                && let Some(v) = robot.v.iter().find(|v| v.abs() > RESTING)
            {
                return Err(("authority", format!("session {session:x} while a joint moves at {v}")));
            }
            if self.person.replace(person).is_some_and(|before| before != person) {
                self.since_person = Some(0);
            }
            self.holder = Some((session, seen.k));
        }
        Ok(())
    }

    /// Notes which sources changed. Returns true if `retarget` or the driver changed.
    fn strangers(&mut self, seen: &Seen<'_>, operator: &OperatorView) -> bool {
        fn other<T: PartialEq + Copy>(known: &mut Option<T>, is: T) -> bool {
            known.replace(is).is_some_and(|was| was != is)
        }
        // An operator who enables sees which person is in front of the robot.
        let knows = operator.enable_edge || !seen.is_person_leading();
        self.since_person = self.since_person.filter(|_| !knows).map(|ticks| ticks + 1);
        if self.stranger_k.is_some_and(|k| k < seen.k) && (operator.enable_edge || operator.recover_edge) {
            self.stranger_k = None;
        }
        let mut restarted = false;
        if let Some(target) = &seen.moment.target_seen {
            restarted |= other(&mut self.behind.retarget, target.header.incarnation);
        }
        let session = seen.target().map_or(0, |target| target.session_nonce);
        let changed = session != 0 && other(&mut self.behind.session, session);
        if let Some(state) = &seen.moment.state_seen {
            restarted |= other(&mut self.behind.driver, state.header.incarnation);
        }
        if restarted || changed {
            self.stranger_k = Some(seen.k);
        }
        restarted
    }

    /// Counts ages in ticks in which control ran. Silence counts from when its source leads.
    fn observe(&mut self, seen: &Seen<'_>, operator: &OperatorView) {
        let by_person = seen.led_by_person();
        self.since_frame = if by_person == [false; 2] { 0 } else { self.since_frame + 1 };
        self.since_target = if seen.target().is_some() { 0 } else { self.since_target + 1 };
        self.since_row = if seen.policy.has_row || by_person == [true; 2] { 0 } else { self.since_row + 1 };
        self.since_state = if seen.moment.state_seen.is_some() { 0 } else { self.since_state + 1 };
        let gap = (seen.k - self.last_k.min(seen.k)).clamp(1, 2);
        let held = operator.enable_level || operator.recover_level;
        self.released = if held { 0 } else { self.released + gap };
        self.armed |= self.released + 2 >= RELEASED;
        if operator.reset_edge {
            self.reset_k = seen.k;
        }
    }

    /// The mode changes only for a logged reason that was present.
    fn transition(&mut self, seen: &Seen<'_>, operator: &OperatorView, mode: Mode) -> Result<(), Broken> {
        let Some(control) = &seen.moment.control else { return Ok(()) };
        let now = (Faults(control.status.faults), operator.release_edge || !operator.enable_level);
        let (faults, released) = if self.mode == Mode::Holding { self.since_hold } else { (Faults::NONE, false) };
        self.since_hold = (faults.union(now.0), released || now.1);
        let count = control.status.transition_count;
        let Some(made) = control.transition else {
            let silent = mode == self.mode && count == self.transitions;
            let text = || format!("{} to {} without a transition", self.mode.name(), mode.name());
            return if silent { Ok(()) } else { Err(("logged reason", text())) };
        };
        let logged = made.from == self.mode as u32 && made.to == mode as u32 && count == self.transitions + 1;
        self.transitions = count;
        // The reason that ended a hold is reported at the end of the hold. Any other reason must be present in
        // this tick.
        let (faults, released) = if self.mode == Mode::Holding { self.since_hold } else { now };
        let there = match made.why {
            Transition::ENABLED => operator.enable_edge && operator.enable_level && now.0.is_empty(),
            Transition::RECOVERING => operator.recover_edge && operator.recover_level,
            Transition::RELEASED => released || (self.mode == Mode::Recovering && !operator.recover_level),
            Transition::RESET => seen.k <= self.reset_k + RESET_PENDING,
            why => Fault::from_u32(why).is_none_or(|fault| faults.has(fault)),
        };
        if logged && there {
            return Ok(());
        }
        let (from, to, why) = (self.mode.name(), mode.name(), made.why_name());
        Err(("logged reason", format!("{from} to {to} because of {why}, which was not active")))
    }

    /// Checks that nothing moves that must not move.
    fn stops(&self, seen: &Seen<'_>, operator: &OperatorView, mode: Mode) -> Result<(), Broken> {
        let Some(control) = &seen.moment.control else { return Ok(()) };
        if operator.estop_edge && mode != Mode::Faulted {
            return Err(("emergency stop", format!("pressed, but the mode is {}", mode.name())));
        }
        let stops = Faults(control.status.faults).with_response(Response::Stop);
        if !stops.is_empty() && mode != Mode::Faulted {
            return Err(("fault", format!("a fault that stops, but the mode is {}", mode.name())));
        }
        if !follows(mode) {
            return Ok(());
        }
        if operator.release_edge || !operator.enable_level {
            return Err(("release", format!("released, but the mode is {}", mode.name())));
        }
        let faults = Faults(control.status.faults);
        if !faults.with_response(Response::Hold).union(faults.with_response(Response::Release)).is_empty() {
            return Err(("fault", format!("a fault that holds, but the mode is {}", mode.name())));
        }
        let now = control.status.header.stamp;
        let silent_ns = now.since(operator.heartbeat_received);
        let slept = seen.k > self.last_k + 1;
        if operator.heartbeat_received == Stamp::NONE || (silent_ns > OPERATOR_SILENT_NS && !slept) {
            return Err(("operator silent", format!("for {} ms, but it follows", silent_ns / 1_000_000)));
        }
        let ages = [
            ("target silent", self.since_target, TARGET_STALE),
            ("robot silent", self.since_state, STATE_LATE),
            ("skeleton silent", if seen.forged { 0 } else { self.since_frame }, INPUT_STALE),
            ("policy silent", self.since_row, INPUT_STALE),
        ];
        let Some((name, age, _)) = ages.iter().find(|(_, age, most)| age > most) else { return Ok(()) };
        Err((name, format!("for {age} ticks, but it follows")))
    }
}
