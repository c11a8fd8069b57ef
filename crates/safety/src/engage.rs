//! The state machine that owns engagement.
//!
//! ```text
//!               enable edge, no fault                aligned
//!  Disengaged --------------------------> Engaging ------------> Engaged
//!   ^ ^  |                                |    ^                   |
//!   | |  | recover edge,  Hold/Release    |    | cleared in time,  | Hold/Release fault,
//!   | |  | only the start fault, or       |    | enable still held | or operator release
//!   | |  | is wrong       release         v    |                   |
//!   | +--|--- at rest, not resumable - Holding <-------------------+
//!   |    v                                ^
//!   +- Recovering ------------------------+ recovery released, or another fault
//!      recovered, or no way
//!  any -- Stop fault --> Faulted -- reset edge, cause gone, at rest, nothing held --> Disengaged
//! ```
//!
//! The file `tests/engage.txt` lists the same for every state and event, fault by fault. The diagram in
//! ARCHITECTURE.md is generated from it.
//!
//! A hold may have only a gap as its cause: no skeleton, no target or no state. If the gap lasts 2 s at most, the
//! machine goes straight back to Engaged, or goes on with Engaging where it was if its slow second was over. The
//! robot then moves on from where it rests, within its limits. Every other hold that resumes leads to a new Engaging.
//!
//! Edges grant authority, levels withdraw it. A stop overrides everything else in the same tick. A restart
//! never engages: a new `State` is Disengaged, and must first see the enable released.
//!
//! While the robot follows, lesser problems may reduce its speed (to [`SLOW`] or below). These are a late
//! skeleton or target, a target that jumped, and several missed deadlines in a row.

mod config;
mod input;
mod recovery;
mod reduced;
mod watch;

use messages::{Fault, Faults, Mode, Response, Stamp, Transition};

pub use config::{Config, ConfigError, Settings};
pub use input::{Input, MotionView, OperatorView, Output, RobotView, TargetView};
pub use messages::Permit;
pub use reduced::SLOW;

use reduced::Reduced;
use watch::{ModeView, Watch, charged_ns};

/// Share of the velocity limits in the first second of engaging. It is slow enough for the operator to let go
/// before anything has moved far.
pub const SPEED_SCALE_FIRST: f64 = 0.05;
/// Duration of this first, slow part, ns.
const FIRST_NS: u64 = 1_000_000_000;
/// Duration of the ramp to full speed that follows, ns.
pub const RAMP_NS: u64 = 2_000_000_000;
/// Time for which a blocked motion must have settled at full speed scale before the target counts as reached, ns.
const SETTLED_NS: u64 = 500_000_000;
/// Time for which an accepted reset waits for the driver to clear its own latch, ns. The echo of a command
/// takes two ticks. The 100 ms leave room for a loaded machine.
const RESET_PENDING_NS: u64 = 100_000_000;

/// Faults that hold while no data of the person arrives, or for a moment none of the robot. They do not mean
/// that anything is wrong with either.
const GAPS: Faults =
    Faults::NONE.with(Fault::InputStale).with(Fault::NoTarget).with(Fault::TargetStale).with(Fault::StateLate);
/// After a gap of at most this time the robot follows again as before, ns. Assumption: an operator who holds the
/// enable for two more seconds expects the robot to continue.
const GAP_MAX_NS: u64 = 2_000_000_000;

/// Internal states, with the data that exists only in them. Times count only while this process is awake.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Phase {
    Disengaged,
    Engaging {
        elapsed_ns: u64,
        settled_ns: u64,
    },
    Engaged,
    /// `ended` is None while the hold can resume. Otherwise it is the code of the transition that follows.
    /// `gap` is given if nothing but [`GAPS`] has caused the hold: the phase that goes on after it.
    Holding {
        elapsed_ns: u64,
        ended: Option<u32>,
        gap: Option<Gap>,
    },
    Faulted {
        cause: Fault,
        reset_pending_ns: Option<u64>,
    },
    Recovering {
        blocked_ns: u64,
    },
}

/// The phase that a gap interrupts: Engaged, or Engaging after some time.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Gap {
    Engaging { elapsed_ns: u64 },
    Engaged,
}

impl From<Gap> for Phase {
    fn from(gap: Gap) -> Self {
        match gap {
            // What has settled before the gap may move after it.
            Gap::Engaging { elapsed_ns } if elapsed_ns >= FIRST_NS => Self::Engaging { elapsed_ns, settled_ns: 0 },
            Gap::Engaging { .. } => Self::engaging(),
            Gap::Engaged => Self::Engaged,
        }
    }
}

impl Phase {
    const fn engaging() -> Self {
        Self::Engaging { elapsed_ns: 0, settled_ns: 0 }
    }

    const fn holding(ended: Option<u32>) -> Self {
        Self::Holding { elapsed_ns: 0, ended, gap: None }
    }

    const fn mode(self) -> Mode {
        match self {
            Self::Disengaged => Mode::Disengaged,
            Self::Engaging { .. } => Mode::Engaging,
            Self::Engaged => Mode::Engaged,
            Self::Holding { .. } => Mode::Holding,
            Self::Faulted { .. } => Mode::Faulted,
            Self::Recovering { .. } => Mode::Recovering,
        }
    }
}

/// State that is kept between ticks.
#[derive(Clone, Debug)]
pub struct State {
    phase: Phase,
    watch: Watch,
    reduced: Reduced,
    latched: Faults,
    /// None until the driver has reported the last reset edge that it saw.
    reset_count: Option<u32>,
}

impl State {
    /// The mode after the last tick.
    pub const fn mode(&self) -> Mode {
        self.phase.mode()
    }

    /// The fault that led to Faulted, while Faulted.
    pub const fn cause(&self) -> Option<Fault> {
        match self.phase {
            Phase::Faulted { cause, .. } => Some(cause),
            Phase::Disengaged
            | Phase::Engaging { .. }
            | Phase::Engaged
            | Phase::Holding { .. }
            | Phase::Recovering { .. } => None,
        }
    }
}

impl Default for State {
    /// Starts Disengaged, with no data seen yet.
    fn default() -> Self {
        Self {
            phase: Phase::Disengaged,
            watch: Watch::default(),
            reduced: Reduced::default(),
            latched: Faults::NONE,
            reset_count: None,
        }
    }
}

/// Share of the velocity limits, `elapsed_ns` after engaging began.
///
/// With s = (t - 1 s) / 2 s clamped to [0, 1] it is 0.05 + 0.95 (3 s^2 - 2 s^3). So neither the scale nor its
/// slope jumps.
pub fn speed_scale(elapsed_ns: u64) -> f64 {
    let s = elapsed_ns.saturating_sub(FIRST_NS).min(RAMP_NS) as f64 / RAMP_NS as f64;
    SPEED_SCALE_FIRST + (1.0 - SPEED_SCALE_FIRST) * s * s * (3.0 - 2.0 * s)
}

/// Judges tick `input.k`. It is deterministic, and it never allocates, blocks, logs, reads a clock or panics.
pub fn tick(config: &Config, state: &mut State, now: Stamp, input: Input) -> Output {
    if state.reset_count.is_none() && input.robot.received != Stamp::NONE {
        state.reset_count = Some(input.robot.reset_count);
    }
    let before = state.phase;
    let mode = ModeView {
        has_authority: match before {
            Phase::Engaging { .. } | Phase::Engaged | Phase::Recovering { .. } => true,
            Phase::Holding { ended, .. } => ended.is_none(),
            Phase::Disengaged | Phase::Faulted { .. } => false,
        },
        hold_expired: matches!(before, Phase::Holding { elapsed_ns, .. } if elapsed_ns >= config.hold_timeout_ns),
        jumps_on: state.reduced.jumps_on(config, &input),
    };
    let active = state.watch.judge(config, mode, now, &input);
    let stops = active.with_response(Response::Stop);
    state.latched = state.latched.union(stops);
    let (share, why_reduced) = state.reduced.judge(config, state.watch.ages, &input);

    let (phase, why) = if stops.is_empty() { next(state, &input, active) } else { stop(state, &input, stops) };
    let asked = input.operator.enable_edge || input.operator.recover_edge;
    let refused = asked && before == Phase::Disengaged && phase == Phase::Disengaged;
    let transition = (before.mode() != phase.mode()).then(|| Transition {
        k: input.k,
        from: before.mode() as u32,
        to: phase.mode() as u32,
        why,
        about: 0,
    });
    state.phase = phase;
    Output {
        mode: phase.mode(),
        permit: permit(phase, share),
        reduced: if matches!(phase, Phase::Engaging { .. } | Phase::Engaged) { why_reduced } else { 0 },
        active,
        latched: state.latched,
        transition,
        refused,
        at_rest: input.at_rest(),
        reset_count: state.reset_count.unwrap_or(0),
        fault_counts: state.watch.counts,
    }
}

/// The permit of a phase at a share of the speed. Engaged has full scale at once, because it is reached
/// either aligned or at the end of the ramp.
fn permit(phase: Phase, share: f64) -> Permit {
    match phase {
        Phase::Engaging { elapsed_ns, .. } => Permit::Follow { speed_scale: share * speed_scale(elapsed_ns) },
        Phase::Engaged => Permit::Follow { speed_scale: share },
        Phase::Recovering { .. } => Permit::Recover,
        Phase::Disengaged | Phase::Holding { .. } | Phase::Faulted { .. } => Permit::Stop,
    }
}

/// Handles a tick at which a Stop fault holds. The next phase is Faulted, whatever else happens at this tick.
fn stop(state: &mut State, input: &Input, stops: Faults) -> (Phase, u32) {
    if let Phase::Faulted { cause, reset_pending_ns } = state.phase {
        let only_driver = stops == Faults::NONE.with(Fault::DriverFault);
        let pending = if only_driver { waiting(state, input, reset_pending_ns) } else { None };
        return (Phase::Faulted { cause, reset_pending_ns: pending }, 0);
    }
    // The operator's stop is named first, because the operator expects to read it.
    let first = if stops.has(Fault::EmergencyStop) { Some(Fault::EmergencyStop) } else { stops.iter().next() };
    let cause = first.unwrap_or(Fault::EmergencyStop);
    (Phase::Faulted { cause, reset_pending_ns: None }, cause as u32)
}

/// The driver keeps its latch until a command carries a new reset count. So the driver's fault alone does not
/// refuse a reset. The reset is passed on, and Faulted is left once the driver's flag is gone.
fn waiting(state: &mut State, input: &Input, pending_ns: Option<u64>) -> Option<u64> {
    if may_reset(input) {
        state.reset_count = state.reset_count.map(|count| count.wrapping_add(1));
        return Some(0);
    }
    let left = pending_ns.map(|ns| ns.saturating_add(charged_ns(input.own_gap_ns)));
    left.filter(|&ns| ns <= RESET_PENDING_NS && input.at_rest() && !held(input))
}

fn may_reset(input: &Input) -> bool {
    input.operator.reset_edge && input.at_rest() && !held(input)
}

/// Returns true if the operator holds the enable or the recovery.
fn held(input: &Input) -> bool {
    input.operator.enable_level || input.operator.recover_level
}

/// Handles a tick at which no Stop fault holds.
fn next(state: &mut State, input: &Input, active: Faults) -> (Phase, u32) {
    match state.phase {
        Phase::Disengaged => disengaged(state, input, active),
        Phase::Engaging { elapsed_ns, settled_ns } => withdrawn(input, active, Gap::Engaging { elapsed_ns })
            .unwrap_or_else(|| engaging(input, elapsed_ns, settled_ns, state.reduced.is_full())),
        Phase::Engaged => withdrawn(input, active, Gap::Engaged).unwrap_or((Phase::Engaged, 0)),
        Phase::Holding { elapsed_ns, ended, gap } => {
            holding(input, active, elapsed_ns, ended, gap.filter(|_| active.is_in(GAPS)))
        }
        Phase::Faulted { cause, reset_pending_ns } => faulted(state, input, cause, reset_pending_ns),
        Phase::Recovering { blocked_ns } => recovery::next(input, active, blocked_ns),
    }
}

fn disengaged(state: &State, input: &Input, active: Faults) -> (Phase, u32) {
    let operator = &input.operator;
    let asked = operator.enable_edge && operator.enable_level && !operator.release_edge;
    let ready = state.watch.armed() && state.watch.operator_alive && input.at_rest();
    if ready && asked && active.is_empty() {
        (Phase::engaging(), Transition::ENABLED)
    } else if ready && recovery::begins(input, active) {
        (Phase::Recovering { blocked_ns: 0 }, Transition::RECOVERING)
    } else {
        (Phase::Disengaged, 0)
    }
}

/// Decides whether authority ends or pauses at this tick, and why. Release is judged before Hold, because it
/// is the stronger.
fn withdrawn(input: &Input, active: Faults, gap: Gap) -> Option<(Phase, u32)> {
    // The cause is reported at this transition. The later transition at rest has no other cause.
    let ended = Some(Transition::AT_REST);
    if let Some(fault) = active.with_response(Response::Release).iter().next() {
        return Some((Phase::holding(ended), fault as u32));
    }
    if let Some(fault) = active.with_response(Response::Hold).iter().next() {
        let ended = released(input).then_some(Transition::RELEASED);
        let gap = active.is_in(GAPS).then_some(gap);
        return Some((Phase::Holding { elapsed_ns: 0, ended, gap }, fault as u32));
    }
    released(input).then_some((Phase::holding(ended), Transition::RELEASED))
}

fn released(input: &Input) -> bool {
    input.operator.release_edge || !input.operator.enable_level
}

fn engaging(input: &Input, elapsed_ns: u64, settled_ns: u64, unreduced: bool) -> (Phase, u32) {
    let charged = charged_ns(input.own_gap_ns);
    let elapsed_ns = elapsed_ns.saturating_add(charged);
    // A command that stands still because its speed is reduced has not settled.
    let full_speed = elapsed_ns >= FIRST_NS + RAMP_NS && unreduced;
    let settled_ns = if full_speed && input.motion.settled { settled_ns.saturating_add(charged) } else { 0 };
    if elapsed_ns >= FIRST_NS && input.motion.aligned {
        (Phase::Engaged, Transition::ALIGNED)
    } else if settled_ns >= SETTLED_NS {
        (Phase::Engaged, Transition::SETTLED)
    } else {
        (Phase::Engaging { elapsed_ns, settled_ns }, 0)
    }
}

fn holding(input: &Input, active: Faults, elapsed_ns: u64, ended: Option<u32>, gap: Option<Gap>) -> (Phase, u32) {
    // A clutch may be held for as long as its operator holds the enable, too. Other causes of a hold have their time.
    let clutch_alone = active.with_response(Response::Hold) == Faults::NONE.with(Fault::Clutch);
    let charged = if clutch_alone { 0 } else { charged_ns(input.own_gap_ns) };
    let elapsed_ns = elapsed_ns.saturating_add(charged);
    let fault = || active.with_response(Response::Release).iter().next().map(|fault| fault as u32);
    let ended = ended.or(if released(input) { Some(Transition::RELEASED) } else { fault() });
    match ended {
        _ if !input.at_rest() => (Phase::Holding { elapsed_ns, ended, gap }, 0),
        Some(_) if active.has(Fault::HoldTimeout) => (Phase::Disengaged, Fault::HoldTimeout as u32),
        Some(why) => (Phase::Disengaged, why),
        None if active.is_empty() => {
            let gap = gap.filter(|_| elapsed_ns <= GAP_MAX_NS);
            (gap.map_or(Phase::engaging(), Phase::from), Transition::CLEARED)
        }
        None => (Phase::Holding { elapsed_ns, ended, gap }, 0),
    }
}

fn faulted(state: &mut State, input: &Input, cause: Fault, pending_ns: Option<u64>) -> (Phase, u32) {
    let driver_cleared = pending_ns.is_some() && input.at_rest() && !held(input);
    if may_reset(input) {
        state.reset_count = state.reset_count.map(|count| count.wrapping_add(1));
    } else if !driver_cleared {
        return (Phase::Faulted { cause, reset_pending_ns: None }, 0);
    }
    state.latched = Faults::NONE;
    (Phase::Disengaged, Transition::RESET)
}
