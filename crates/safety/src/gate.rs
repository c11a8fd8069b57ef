//! The last gate: every command passes here. If a command fails a check, the stored stop plan replaces it,
//! for all joints.
//!
//! The gate proposes nothing and has no stop profile of its own. It judges in integers (see `fixed`). For
//! each joint it checks the following:
//!
//! - The command is finite. It keeps the position, velocity and acceleration limits, also inside its tick.
//! - The command is one tick of admissible jerk after the last one, or the next point of the stored plan.
//! - The plan of the command comes to rest inside the limits.
//!
//! The gate has its own kinematics and distances. With them it checks that the command, ten instants of the
//! plan, and its rest posture are clear of self-collision and of the surroundings (see `stop_clearance`). The
//! certificate of whole-body control covers what lies between these instants. So an error of that certificate
//! is bounded by how much a robot can come closer and move apart again between two instants.
//!
//! In a recovery the gate allows more positions and less speed. A joint outside its limits may be anywhere
//! between its last position and the limit. The least clearance may be that of the last command. The speed is
//! at most the recovery's.

mod body;
mod check;
mod denial;
mod fixed;
mod hand;
mod interface;
mod known;
mod stop;
mod stop_clearance;
mod stored;
#[cfg(test)]
mod tests;

use messages::{JOINTS_MAX, JointMotion, Stamp};
use robot::Model;

pub use check::{Check, ConfigError};
pub use denial::Denial;
pub use interface::Interface;

use crate::engage::Permit;
use check::{Limits, all_limits, comes_to_rest, same_stop};
use fixed::{Point, UNITS};
use stop::Stop;
use stop_clearance::{Memory, Requirement, StopClearance};
use stored::{Phases, Stored, quantised_phases, write_phases};

/// Slack for the distance routine, m. It errs by less than 1e-12 m at the size of a robot (`clearance` tests).
const CLEARANCE_SLACK_M: f64 = 1e-9;

/// Slack for the rounding of a clearance that a recovery does not change, m. Positions are rounded to 1e-12
/// rad between two ticks.
const RECOVERY_SLACK_M: f64 = 1e-10;

/// Largest speed of a recovery, rad/s and m/s. Assumption, see `wbc`. The gate enforces this bound.
const RECOVERY_RAD_PER_S: f64 = 0.1;
const RECOVERY_M_PER_S: f64 = 0.01;

/// Validated limits and geometry.
#[derive(Clone, Debug)]
pub struct Config {
    /// Number of the robot's joints. Everything beyond it must be zero.
    count: usize,
    limits: [Limits; JOINTS_MAX],
    stop_clearance: StopClearance,
    d_min_m: f64,
    /// Largest speed of each joint in a recovery, in units.
    recovery_v: [i64; JOINTS_MAX],
    /// Largest speed of an elbow or a hand, m/s. None without a bound, or if joints within their limits cannot
    /// exceed it.
    hand_speed_m_per_s: Option<f64>,
}

impl Config {
    /// Creates the configuration from the effective limits of `model`, its collision pairs and its least
    /// clearance. It assumes that the robot executes every command at its time.
    pub fn new(model: &Model) -> Result<Self, ConfigError> {
        Self::with_interface(model, &Interface::default())
    }

    /// Creates the configuration for a robot that executes the commands through `interface`.
    pub fn with_interface(model: &Model, interface: &Interface) -> Result<Self, ConfigError> {
        if !(model.d_min_m > 0.0 && model.d_min_m.is_finite()) {
            return Err(ConfigError::Clearance(model.d_min_m));
        }
        Ok(Self {
            count: model.count,
            limits: all_limits(&model.joint_names, &model.limits, model.stop_time_max_s)?,
            stop_clearance: StopClearance::new(model, interface, &model.limits)?,
            d_min_m: model.d_min_m,
            recovery_v: model.prismatic.map(|slides| {
                let speed = if slides { RECOVERY_M_PER_S } else { RECOVERY_RAD_PER_S };
                (speed * UNITS) as i64
            }),
            hand_speed_m_per_s: None,
        })
    }

    /// Looks at every pair in every tick, so that a test can compare the verdicts.
    pub fn without_known_for_tests(mut self) -> Self {
        self.stop_clearance.uses_known = false;
        self
    }

    /// Adds a bound: elbows and hands move no faster than `max` in the base frame, m/s.
    pub fn with_hand_speed(self, max: f64) -> Result<Self, ConfigError> {
        // Written so that NaN is refused too.
        if !(max > 0.0 && max.is_finite()) {
            return Err(ConfigError::HandSpeed(max));
        }
        let fastest = self.limits.map(|limits| limits.v as f64 / UNITS);
        let body = &self.stop_clearance.body;
        let could = (0..body.point_count()).any(|i| body.fastest(i, &fastest) > max);
        Ok(Self { hand_speed_m_per_s: could.then_some(max), ..self })
    }
}

/// State of the gate: the last state that was sent, with its plan. It belongs to one configuration.
#[derive(Clone, Debug)]
pub struct State {
    stored: Stored,
    /// Tick index of that state. None after a seed, which is the state of the tick before the next one.
    k: Option<u64>,
    /// The gate could not use the last seed.
    seed_refused: bool,
    /// Number of commands denied since start.
    denials: u64,
    /// Known bounds of the distances, and working memory.
    memory: Box<Memory>,
}

impl State {
    /// Creates the state at rest at `q` (rad, m). A position that is not finite or too large becomes zero,
    /// and then every command is denied until a usable seed arrives.
    pub fn at_rest(q: [f64; JOINTS_MAX]) -> Self {
        let points = q.map(|q| Point::quantised(q, 0.0, 0.0));
        let origin = points.map(Option::unwrap_or_default);
        let seed_refused = points.contains(&None);
        Self {
            stored: Stored::new(origin, [Phases::default(); JOINTS_MAX]),
            k: None,
            seed_refused,
            denials: 0,
            memory: Memory::new(),
        }
    }

    /// Continues from the state that the driver reports, with the stop that it would play from there. This is
    /// the state of the tick before the next one. The robot is where it is, so a seed need not lie within the
    /// limits. But it must be finite and come to rest. Every command is denied until a usable seed arrives.
    pub fn reseed(&mut self, seed: &JointMotion) {
        let JointMotion { q, v, a, plan } = seed;
        let mut origin = [Point::default(); JOINTS_MAX];
        let mut phases = [Phases::default(); JOINTS_MAX];
        self.seed_refused = true;
        for j in 0..JOINTS_MAX {
            let (Some(point), Some(stop)) = (Point::quantised(q[j], v[j], a[j]), quantised_phases(plan, j)) else {
                return;
            };
            if !comes_to_rest(point, &stop) {
                return;
            }
            (origin[j], phases[j]) = (point, stop);
        }
        self.seed_refused = false;
        self.stored = Stored::new(origin, phases);
        self.k = None;
    }

    /// Number of commands denied since start.
    pub const fn denials(&self) -> u64 {
        self.denials
    }

    /// The motion last sent, and the rest of its stop.
    pub fn motion(&self) -> JointMotion {
        motion(&self.stored)
    }
}

/// Command that whole-body control proposes for tick `k`.
#[derive(Clone, Copy, Debug)]
pub struct Proposed {
    /// Tick index.
    pub k: u64,
    /// Permit of the state machine at this tick.
    pub permit: Permit,
    /// The motion and its stop.
    pub motion: JointMotion,
}

/// Decision of the gate.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// The command is a new motion: the proposal, rounded to the gate's units.
    Accept,
    /// The command is the next point of the stored plan.
    OnPlan,
    /// The command is denied, and every joint plays the stored plan.
    Deny(Denial),
}

/// Command to send for this tick. It is always complete.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Decision {
    /// Verdict on the proposal.
    pub verdict: Verdict,
    /// The motion and its stop.
    pub motion: JointMotion,
    /// Least clearance of the command by the gate's own measure, m. NaN if a plan is played and the gate measured none.
    pub clearance_m: f64,
}

impl Decision {
    /// Returns true if the proposal was sent, and false if the stored plan replaced it.
    pub const fn accepted(&self) -> bool {
        matches!(self.verdict, Verdict::Accept | Verdict::OnPlan)
    }
}

/// Judges the command of tick `k`. It is deterministic, and it never allocates, blocks, logs, reads a clock or panics.
///
/// ```
/// # let read = |kind| std::fs::read_to_string(format!("../../config/robots/tiago_dual.{kind}"));
/// # let model = robot::Model::from_text("tiago_dual.toml", &read("toml")?, "tiago_dual.urdf", &read("urdf")?)?;
/// use messages::JointMotion;
/// use safety::{engage::Permit, gate::{Config, Proposed, State, tick}};
///
/// let (config, mut state) = (Config::new(&model)?, State::at_rest(model.home));
/// let permit = Permit::Follow { speed_scale: 1.0 };
/// let mut jump = Proposed { k: 1, permit, motion: JointMotion::rest(model.home) };
/// jump.motion.q[3] += 0.1; // In one tick.
/// let sent = tick(&config, &mut state, messages::deadline(1), jump);
/// assert!(!sent.accepted() && (sent.motion.q[3] - model.home[3]).abs() < 1e-9);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn tick(config: &Config, state: &mut State, _now: Stamp, proposed: Proposed) -> Decision {
    let ticks = match state.k {
        // A seed is by agreement the state of the tick before this one, however many ticks ago it was taken.
        None => 1,
        Some(last) => proposed.k.saturating_sub(last),
    };
    let (verdict, clearance_m) = match judge(config, state, ticks, &proposed) {
        Ok(Some((stored, clearance_m))) => {
            state.stored = stored;
            (Verdict::Accept, clearance_m)
        }
        Ok(None) => {
            state.stored.play(ticks);
            (Verdict::OnPlan, f64::NAN)
        }
        Err(denial) => {
            state.denials = state.denials.saturating_add(1);
            state.stored.play(ticks);
            (Verdict::Deny(denial), f64::NAN)
        }
    };
    state.k = Some(state.k.map_or(proposed.k, |last| last.max(proposed.k)));
    // The judged, rounded values are sent, and not the proposal's own bits.
    Decision { verdict, motion: motion(&state.stored), clearance_m }
}

/// Judges a proposal. Returns the new motion with its least clearance, m. None if it is the stored plan, as it is played.
fn judge(config: &Config, state: &mut State, ticks: u64, proposed: &Proposed) -> Result<Option<(Stored, f64)>, Denial> {
    if state.seed_refused {
        return Err(Denial::Seed);
    }
    if ticks != 1 {
        return Err(Denial::Index);
    }
    let mut next = [Point::default(); JOINTS_MAX];
    let mut phases = [Phases::default(); JOINTS_MAX];
    let mut on_plan = [Point::default(); JOINTS_MAX];
    let mut all_on_plan = true;
    let motion = &proposed.motion;
    for j in 0..config.count {
        let point = Point::quantised(motion.q[j], motion.v[j], motion.a[j]);
        let stop = quantised_phases(&motion.plan, j);
        let denial = Denial::Joint { joint: j, check: Check::Finite };
        (next[j], phases[j]) = point.zip(stop).ok_or(denial)?;
        let (plan_point, plan_rest) = state.stored.joint(j, ticks);
        on_plan[j] = plan_point;
        all_on_plan &= next[j].is_near(plan_point, check::SLACK) && same_stop(&phases[j], &plan_rest);
    }
    if let Some(joint) = (config.count..JOINTS_MAX).find(|&j| !is_absent(motion, j)) {
        return Err(Denial::Joint { joint, check: Check::Absent });
    }
    if all_on_plan {
        // A denial would send the same command. So there is nothing to judge, and the gate's own values are sent.
        return Ok(None);
    }
    let speed_scale = match proposed.permit {
        Permit::Follow { speed_scale } => speed_scale,
        Permit::Recover => 1.0,
        Permit::Stop => return Err(Denial::Permit),
    };
    let recovers = proposed.permit == Permit::Recover;
    let last: [Point; JOINTS_MAX] = core::array::from_fn(|j| state.stored.joint(j, 0).0);
    let mut stops = [Stop::new(Point::default(), &Phases::default()); JOINTS_MAX];
    for j in 0..config.count {
        let limits = &config.limits[j];
        let limits = if recovers { &limits.recovering(last[j], config.recovery_v[j]) } else { limits };
        let judged = limits
            .step(last[j], next[j], on_plan[j])
            .and_then(|()| limits.slow(last[j], next[j], on_plan[j], speed_scale))
            .and_then(|()| limits.stop(next[j], &phases[j]));
        stops[j] = judged.map_err(|check| Denial::Joint { joint: j, check })?;
    }
    if let Some(max) = config.hand_speed_m_per_s {
        hand::judge(&config.stop_clearance.body, max, &next, &stops)?;
    }
    let mut required = Requirement { least_m: config.d_min_m - CLEARANCE_SLACK_M, interface: !recovers };
    if recovers {
        let at_last = config.stop_clearance.clearance_m(&last.map(|point| point.q as f64 / UNITS));
        // If the clearance is NaN, d_min stays.
        required.least_m = required.least_m.min(at_last - RECOVERY_SLACK_M);
    }
    let clearance_m = config.stop_clearance.judge(&next, &stops, required, &mut state.memory)?;
    Ok(Some((Stored::new(next, phases), clearance_m)))
}

/// Returns true if a motion has nothing but zeros for a joint.
fn is_absent(motion: &JointMotion, j: usize) -> bool {
    let phases = motion.plan.jerk[j].iter().chain(&motion.plan.duration_s[j]);
    [motion.q[j], motion.v[j], motion.a[j]].iter().chain(phases).all(|x| *x == 0.0)
}

/// Returns the motion that plays `stored`.
fn motion(stored: &Stored) -> JointMotion {
    let mut out = JointMotion::rest([0.0; JOINTS_MAX]);
    for j in 0..JOINTS_MAX {
        let (point, rest) = stored.joint(j, 0);
        out.q[j] = point.q as f64 / UNITS;
        out.v[j] = point.v as f64 / UNITS;
        out.a[j] = point.a as f64 / UNITS;
        write_phases(&mut out.plan, j, &rest);
    }
    out
}
