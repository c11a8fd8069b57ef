//! One period of whole-body control: what each joint would like, what it may, and what all of them together are proved
//! to survive.

use crate::barrier::{Barrier, Program};
use crate::certificate::{Purpose, Scratch, Verdict, certify};
use crate::choose::{Aims, Choice, Chooser, aims};
use crate::clearance::Anchor;
use crate::config::{Config, ENGAGE_MARGIN_M};
use crate::dynamics::PerJoint;
use crate::motion::Motion;
use crate::plan::{JointState, Planned};
use crate::recover::Recovery;
use crate::torque::{self, Load, TorqueScratch, TorqueVerdict};
use messages::{ALL_JOINTS, JOINTS, PayloadRefusal, Stamp, StopPlan, TICK_S, command_flag};
use robot::Payload;

/// A joint within this of its target counts as on target, rad or m; half the limb error that a viewer can see.
const ON_TARGET: f64 = 0.01;

/// Where the joints should be; any values, not even finite ones are required.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Target<'a> {
    /// Positions, rad or m.
    pub q: &'a [f64; JOINTS],
    /// Velocities, rad/s or m/s.
    pub dq: &'a [f64; JOINTS],
    /// Accelerations of the way that is followed, rad/s^2 or m/s^2; zero where none is known.
    pub ddq: &'a [f64; JOINTS],
    /// Bit j: joint j is meant; the others go to the home posture.
    pub valid_mask: u32,
}

/// Whether the joints may move.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Permit {
    /// Towards the target.
    Follow {
        /// Share of each joint's largest speed, (0, 1]; anything that is not above zero stops. While a joint is faster
        /// than a scale that fell, it does not get faster.
        speed_scale: f64,
    },
    /// Back inside the limits and away from near pairs, slowly, whatever the target is.
    Recover,
    /// Play the stop and stay.
    Stop,
}

/// What a tick is given.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Input<'a> {
    /// Index of the tick.
    pub k: u64,
    /// None: hold.
    pub target: Option<Target<'a>>,
    /// Whether the joints may move.
    pub permit: Permit,
}

/// Which joints took a new decision; all others play the plan. Torso and head belong to no arm: they move only with
/// `All`, so that a blocked arm never moves the other one's base.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Candidate {
    /// All joints.
    All,
    /// The left arm.
    Left,
    /// The right arm.
    Right,
    /// None.
    Plan,
}

/// What a tick decides: the command of tick k, complete in every case.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Output {
    /// Joint positions, rad or m.
    pub q: [f64; JOINTS],
    /// Joint velocities, rad/s or m/s.
    pub v: [f64; JOINTS],
    /// Joint accelerations, rad/s^2 or m/s^2.
    pub a: [f64; JOINTS],
    /// The certified stop from there.
    pub plan: StopPlan,
    /// Which joints took a new decision.
    pub candidate: Candidate,
    /// Bit j: joint j is the next point of the plan before it, not a new decision.
    pub on_plan: u32,
    /// Smallest distance of the checked pairs and from obstacles at this command, m.
    pub clearance_m: f64,
    /// Indices of the capsules of that pair; for an obstacle the number of capsules and its index.
    pub nearest_pair: [u32; 2],
    /// Every joint stands still.
    pub at_rest: bool,
    /// Every joint is within 0.01 rad (m) of its target; false without one.
    pub on_target: bool,
    /// `at_rest` or `on_target`.
    pub settled: bool,
    /// Whether the wishes were changed because pairs are near.
    pub program: Program,
    /// Motions that were wanted but not certified in this tick.
    pub fallbacks: u32,
    /// The pair for which the first of them could not be, as `nearest_pair`.
    pub refused_pair: Option<[u32; 2]>,
    /// Motions among them whose torques could not be proved, and the joint of the first.
    pub overloads: u32,
    /// See `overloads`.
    pub overloaded_joint: Option<u32>,
    /// Evaluations of the kinematics and of the dynamics.
    pub evaluations: u32,
}

impl Output {
    /// The flags of the command of this tick. A gate that `denied` it has all joints play the plan.
    pub fn command_flags(&self, denied: bool) -> u32 {
        if denied || self.candidate == Candidate::Plan { command_flag::ON_PLAN } else { 0 }
    }
}

/// Everything that the stage remembers: the last command with its certified plan, and working memory.
#[derive(Clone, Debug)]
pub struct State {
    planned: Planned,
    anchor: Anchor,
    barrier: Barrier,
    recovery: Recovery,
    scratch: Scratch,
    torque: TorqueScratch,
    /// Masses and motors with what the hands carry; none if nothing is to be proved of them.
    load: Option<Load>,
}

impl State {
    /// At rest at `q`.
    pub fn at_rest(config: &Config, q: [f64; JOINTS]) -> Self {
        Self {
            planned: Planned::at_rest(q),
            anchor: Anchor::new(&config.geometry, q),
            barrier: Barrier::new(&config.geometry, q),
            recovery: Recovery::new(&config.geometry, q),
            scratch: Scratch::new(&config.geometry),
            torque: TorqueScratch::new(),
            load: config.load.clone(),
        }
    }

    /// Continues from another state with its certified plan: what the driver says it executes. Never allocates.
    pub fn reseed(&mut self, planned: &Planned) {
        self.planned = *planned;
    }

    /// What the hands carry from now on, if the robot is at rest. The joint that asks for more than its share to hold the posture
    /// with it, if any: then no decision is taken. Never allocates.
    ///
    /// # Errors
    /// `Moving` where the last command or its plan is not at rest. Then what they carried before stays in force.
    pub fn carry(&mut self, config: &Config, payload: &[Payload; 2]) -> Result<Option<usize>, PayloadRefusal> {
        if !self.planned.is_at_rest() {
            return Err(PayloadRefusal::Moving);
        }
        let Some(load) = &mut self.load else { return Ok(None) };
        load.carry(payload);
        Ok(load.overloaded_at_rest(&config.geometry.chain, &self.planned.q).map(|(joint, ..)| joint))
    }

    /// What the hands carry; of a configuration that proves nothing of torques, nothing.
    pub fn payload(&self) -> [Payload; 2] {
        self.load.as_ref().map_or([Payload::EMPTY; 2], |load| *load.payload())
    }

    /// As the function of that name, with what the hands carry now.
    pub fn overloaded_at_rest(&self, config: &Config, q: &[f64; JOINTS]) -> Option<(usize, f64, f64)> {
        self.load.as_ref()?.overloaded_at_rest(&config.geometry.chain, q)
    }

    /// The last command with its plan.
    pub fn planned(&self) -> &Planned {
        &self.planned
    }
}

/// Advances the stage by one period. Deterministic; never allocates, blocks, logs, reads a clock or panics.
pub fn tick(config: &Config, state: &mut State, _now: Stamp, input: Input<'_>) -> Output {
    let geometry = &config.geometry;
    if state.anchor.q != state.planned.q {
        state.anchor.place(geometry, state.planned.q);
    }
    let on_plan = state.planned.advanced(TICK_S);
    let aims = aims(config, &input);
    let choice = match input.permit {
        Permit::Follow { speed_scale } if speed_scale > 0.0 => {
            let State { planned, anchor, barrier, scratch, torque, load, .. } = state;
            let mut chooser = Chooser { config, load: load.as_ref(), anchor, barrier, scratch, torque };
            chooser.choose(planned, &on_plan, &aims, speed_scale.min(1.0))
        }
        Permit::Recover => {
            let State { planned, anchor, recovery, scratch, torque, load, .. } = state;
            recovery.choose(config, (scratch, torque, load.as_ref()), anchor, planned, &on_plan)
        }
        Permit::Follow { .. } | Permit::Stop => Choice::plan(on_plan),
    };
    state.planned = choice.next;
    state.anchor.place(geometry, choice.next.q);
    output(config, state, &choice, &aims)
}

/// Whether `q`, held at rest, is clear enough to engage: every pair keeps d_min and 3 mm. Also the smallest distance
/// (m) and the capsules of that pair. Not for a tick: it allocates.
pub fn certify_rest(config: &Config, q: &[f64; JOINTS]) -> (bool, f64, [u32; 2]) {
    let anchor = Anchor::new(&config.geometry, *q);
    let clear = anchor.clearance_m >= config.geometry.d_min_m + ENGAGE_MARGIN_M;
    (clear, anchor.clearance_m, nearest_pair(config, &anchor))
}

/// Whether a plan is proved to keep d_min from now to rest, whatever it was made by. Not for a tick: it allocates.
pub fn certify_plan(config: &Config, planned: &Planned) -> Verdict {
    let anchor = Anchor::new(&config.geometry, planned.q);
    let mut scratch = Scratch::new(&config.geometry);
    certify(&config.geometry, &Motion::stops(planned), Purpose::Decision, ALL_JOINTS, &anchor, &mut scratch)
}

/// The joint that asks for more than its share of the effort limit to hold `q` at rest, if any, with its torque and the
/// limit, N m or N. Of the hands as they are at the start.
pub fn overloaded_at_rest(config: &Config, q: &[f64; JOINTS]) -> Option<(usize, f64, f64)> {
    config.load.as_ref()?.overloaded_at_rest(&config.geometry.chain, q)
}

/// Torques of the links in a motion (rad, m, and seconds), N m or N; none of a configuration that proves nothing of them.
pub fn torques(config: &Config, q: &PerJoint, v: &PerJoint, a: &PerJoint) -> Option<PerJoint> {
    let x = std::array::from_fn(|j| JointState { q: q[j], v: v[j], a: a[j] });
    config.load.as_ref().map(|load| load.torques(&config.geometry.chain, &x))
}

/// Whether the torques of a plan are proved to keep their limits from now to rest, whatever it was made by.
pub fn certify_torque(config: &Config, planned: &Planned) -> TorqueVerdict {
    let Some(load) = &config.load else { return TorqueVerdict { blamed: None, evaluations: 0 } };
    let mut scratch = TorqueScratch::new();
    torque::prove(load, &config.geometry.chain, &Motion::stops(planned), ALL_JOINTS, &mut scratch)
}

fn nearest_pair(config: &Config, anchor: &Anchor) -> [u32; 2] {
    if config.geometry.pair_count() == 0 {
        return [0; 2];
    }
    config.geometry.pair(anchor.nearest).map(|capsule| capsule as u32)
}

fn output(config: &Config, state: &State, choice: &Choice, aims: &Aims) -> Output {
    let next = &choice.next;
    let at_rest = next.is_at_rest();
    let on_target = (0..JOINTS).all(|j| aims[j].is_some_and(|aim| (aim.q - next.q[j]).abs() <= ON_TARGET));
    Output {
        q: next.q,
        v: next.v,
        a: next.a,
        plan: next.plan,
        candidate: choice.candidate,
        on_plan: ALL_JOINTS & !choice.fresh,
        clearance_m: state.anchor.clearance_m,
        nearest_pair: nearest_pair(config, &state.anchor),
        at_rest,
        on_target,
        settled: at_rest || on_target,
        program: choice.program,
        fallbacks: choice.fallbacks,
        refused_pair: choice.refused.map(|pair| config.geometry.pair(pair).map(|capsule| capsule as u32)),
        overloads: choice.overloads,
        overloaded_joint: choice.overloaded.map(|j| j as u32),
        evaluations: choice.evaluations,
    }
}
