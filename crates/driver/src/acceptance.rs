//! Judges if a command continues from the executed state.

use crate::chain::CommandChain;
use crate::follower::{Config, State};
use crate::limits::Point;
use crate::plan::{PlanPlayback, residue_at_end};
use messages::{JointCommand, JointMotion, Stamp, TICK_HZ, TICK_S, deadline, tick_at};

/// The largest gap between two setpoints that is still one motion, ticks: 5.3 ms. A drive that carries on by
/// itself over the gap is then off by less than J t^3 / 3. That is 2e-5 rad at the 400 rad/s^3 of an arm. Its own
/// watchdog has not fired: 10 ms in the simulated robot, 20 ms in a UR or a Franka.
pub const GAP_MAX_TICKS: u64 = 8;

/// The longest stop that is accepted, s: ten times the robots' longest stop of 500 ms. It bounds the work of one tick.
pub const PLAN_MAX_S: f64 = 5.0;

/// The largest speed or acceleration (rad/s, rad/s^2, m/s, m/s^2) that a plan may leave at its end. Rounding leaves
/// less than 1e-12. Beyond 1e-7 the end of the plan would be a step that the limits do not cover.
pub const REST_TOLERANCE: f64 = 1e-7;

/// Age of a command, counted from its deadline, beyond which it is dropped: two ticks. It does not matter
/// which process was late.
const AGE_MAX_NS: u64 = 2 * 1_000_000_000 / TICK_HZ;

/// Largest number of indices by which a command may be ahead of the clock.
/// One is for a `control` that its target woke early. One is for clocks that are read on two cores.
const AHEAD_MAX_TICKS: u64 = 2;

/// The reason why a command was refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(usize)]
pub enum Refusal {
    /// A number is NaN or infinite.
    NotFinite = 0,
    /// The plan that came with it does not end at rest, has a negative duration, or is longer than `PLAN_MAX_S`.
    NotAStop = 1,
    /// Its index is more than 2 ahead of the clock.
    TooFarAhead = 2,
    /// Its deadline passed more than 2 ticks ago.
    TooOld = 3,
    /// The fault is latched, or the driver holds the measured posture.
    Latched = 4,
    /// Its chain was left: plan ticks have been played since the last command of the chain.
    ChainLeft = 5,
    /// Its chain continues from a command that is not the last accepted one.
    OtherSeed = 6,
    /// Its chain begins at a plan tick that has been passed.
    SeedPassed = 7,
    /// Its index has been executed already, or is not after the seed of its chain.
    NotAhead = 8,
    /// It needs more jerk than the limits allow in the time between, so it does not continue the state that it names.
    Jump = 9,
    /// Its position, velocity or acceleration is outside the limits.
    OutsideLimits = 10,
    /// It is more than `GAP_MAX_TICKS` after the executed index. The driver was suspended, and the robot is elsewhere.
    Gap = 11,
    /// It is for a robot with another hash, or with another number of joints.
    OtherRobot = 12,
}

impl Refusal {
    /// Number of reasons.
    pub const COUNT: usize = 13;
}

/// The rule under which a command is acceptable.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Rule {
    /// Rule (a): the next command of the same chain.
    Same,
    /// Rule (b): the first command of a new chain. The driver first plays `play_ticks` ticks of the plan.
    New { play_ticks: u64 },
}

/// Makes the checks that do not need the executed state. The driver judges a command further only if it passes them.
pub(crate) fn plausible(config: &Config, now: Stamp, command: &JointCommand) -> Result<(), Refusal> {
    if command.robot != config.robot {
        return Err(Refusal::OtherRobot);
    }
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
    let stops = residue_at_end(&command.motion()) <= REST_TOLERANCE;
    if plan.duration_s.iter().all(short) && stops { Ok(()) } else { Err(Refusal::NotAStop) }
}

/// Returns the rule under which a plausible command continues from the executed state.
pub(crate) fn judge(config: &Config, state: &State, command: &JointCommand) -> Result<Rule, Refusal> {
    if state.latched || state.holds_measured {
        return Err(Refusal::Latched);
    }
    let played = state.plan_ticks_played;
    if command.k.saturating_sub(state.index()) > GAP_MAX_TICKS {
        return Err(Refusal::Gap);
    }
    if state.chain == Some(CommandChain::from_command(command)) {
        if played > 0 {
            return Err(Refusal::ChainLeft);
        }
        if command.k <= state.executed_k {
            return Err(Refusal::NotAhead);
        }
        continues(config, &state.motion, state.executed_k, command)?;
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
    continues(config, &seed, seed_index, command)?;
    Ok(Rule::New { play_ticks })
}

/// Checks that every joint continues within its limits. A command for the state of another driver fails here, for
/// example of one that died in the tick in which this one started.
fn continues(config: &Config, from: &JointMotion, from_k: u64, command: &JointCommand) -> Result<(), Refusal> {
    let dt_s = (command.k - from_k) as f64 * TICK_S;
    for (j, limits) in config.limits.iter().enumerate() {
        let before = Point { q: from.q[j], v: from.v[j], a: from.a[j] };
        let after = Point { q: command.q[j], v: command.v[j], a: command.a[j] };
        limits.continues(before, after, dt_s)?;
    }
    Ok(())
}
