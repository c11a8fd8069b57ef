//! Whether a command continues from what is being executed.

use crate::chain::Chain;
use crate::follower::{Config, State};
use crate::plan::Motion;
use messages::{JOINTS, JointCommand, LEFT_ARM, RIGHT_ARM, Stamp, TICK_HZ, TICK_S, deadline, known_bug, tick_at};

/// The longest stop that is believed, s: ten times the 500 ms that the robots promise. It bounds the work of one tick.
pub const PLAN_MAX_S: f64 = 5.0;

/// The largest speed or acceleration (rad/s, rad/s^2, m/s, m/s^2) that a plan may leave at its end. Rounding leaves less
/// than 1e-12; beyond 1e-7 the end of the plan would be a step that the limits do not know of.
pub const REST_TOLERANCE: f64 = 1e-7;

/// Age of a command, from its deadline, beyond which it is dropped: two ticks, whoever slept.
const AGE_MAX_NS: u64 = 2 * 1_000_000_000 / TICK_HZ;

/// Indices by which a command may be ahead of the clock: one for a `control` woken early by its target, one for clocks
/// read on two cores.
const AHEAD_MAX_TICKS: u64 = 2;

/// Share by which a step may exceed v_max times its duration: rounding only.
const STEP_SLACK: f64 = 1e-6;

/// Why a command was refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(usize)]
pub enum Refusal {
    /// A number is NaN or infinite.
    NotFinite = 0,
    /// The plan that came with it does not end at rest, has a negative duration, or is longer than `PLAN_MAX_S`.
    NotAStop = 1,
    /// Its index lies more than 2 ahead of the clock.
    TooFarAhead = 2,
    /// Its deadline passed more than 2 ticks ago.
    TooOld = 3,
    /// The fault is latched.
    Latched = 4,
    /// Its chain was left: plan ticks have been played since the last command of the chain.
    ChainLeft = 5,
    /// Its chain begins at another command than the last accepted one.
    OtherSeed = 6,
    /// Its chain begins at a plan tick that has been passed.
    SeedPassed = 7,
    /// Its index has been executed already, or lies before its chain's first.
    NotAhead = 8,
    /// It is farther away than the robot can move in the time between: not what it claims to continue.
    Jump = 9,
}

impl Refusal {
    /// Number of reasons.
    pub const COUNT: usize = 10;
}

/// An acceptable command: the rule it was taken under.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Rule {
    /// (a): the next of the same chain.
    Same,
    /// (b): of a new chain; so many plan ticks are played first.
    New { play_ticks: u64 },
}

/// What can be said without knowing the executed state. Only a command that passes is listened to at all.
pub(crate) fn plausible(now: Stamp, command: &JointCommand) -> Result<(), Refusal> {
    let plan = &command.plan;
    let states = command.q.iter().chain(&command.v).chain(&command.a);
    let mut numbers = states.chain(plan.jerk.as_flattened()).chain(plan.duration_s.as_flattened());
    if !numbers.all(|x| x.is_finite()) {
        return Err(Refusal::NotFinite);
    }
    if command.k > tick_at(now).saturating_add(AHEAD_MAX_TICKS) {
        return Err(Refusal::TooFarAhead);
    }
    if now.since(deadline(command.k)) > AGE_MAX_NS {
        return Err(Refusal::TooOld);
    }
    let short = |d: &[f64; 3]| d.iter().all(|&d| d >= 0.0) && d.iter().sum::<f64>() <= PLAN_MAX_S;
    let stops = motion_of(command).residue_at_end() <= REST_TOLERANCE;
    if plan.duration_s.iter().all(short) && stops { Ok(()) } else { Err(Refusal::NotAStop) }
}

/// Whether a plausible command continues from the executed state, and under which rule.
pub(crate) fn judge(config: &Config, state: &State, command: &JointCommand) -> Result<Rule, Refusal> {
    if state.latched {
        return Err(Refusal::Latched);
    }
    let played = state.plan_ticks_played;
    if state.chain == Some(Chain::of(command)) {
        if played > 0 && !known_bug!(LeftChainContinued) {
            return Err(Refusal::ChainLeft);
        }
        if command.k <= state.executed_k {
            return Err(Refusal::NotAhead);
        }
        within_reach(config, &state.motion, state.executed_k, command)?;
        return Ok(Rule::Same);
    }
    if command.seed_k != state.executed_k {
        return Err(Refusal::OtherSeed);
    }
    let Some(play_ticks) = command.seed_played.checked_sub(played) else {
        return Err(Refusal::SeedPassed);
    };
    let seed_index = state.executed_k.saturating_add(command.seed_played);
    if command.k <= seed_index {
        return Err(Refusal::NotAhead);
    }
    let mut seed = state.motion;
    seed.play(play_ticks);
    within_reach(config, &seed, seed_index, command)?;
    Ok(Rule::New { play_ticks })
}

/// No honest command is farther from the state that it continues than v_max allows; a command meant for the state of
/// another driver (one that died in the tick in which this one started) may be.
fn within_reach(config: &Config, from: &Motion, from_k: u64, command: &JointCommand) -> Result<(), Refusal> {
    let dt_s = (command.k - from_k) as f64 * TICK_S;
    let near = |j: usize| (command.q[j] - from.q[j]).abs() <= config.v_max[j] * dt_s * (1.0 + STEP_SLACK);
    let slow = |j: usize| command.v[j].abs() <= config.v_max[j] * (1.0 + STEP_SLACK);
    if (0..JOINTS).all(|j| near(j) && slow(j)) { Ok(()) } else { Err(Refusal::Jump) }
}

/// The motion that a command asks for.
pub(crate) fn motion_of(command: &JointCommand) -> Motion {
    let mut motion = Motion { q: command.q, v: command.v, a: command.a, plan: command.plan };
    if known_bug!(JointsSwapped) {
        motion.q.swap(LEFT_ARM.start, RIGHT_ARM.start);
    }
    motion
}
