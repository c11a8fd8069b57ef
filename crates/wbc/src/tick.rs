//! One period of whole-body control: the wanted motion of each joint, its admissible range, and a motion of
//! all joints that is proved.

use crate::barrier::{Barrier, Program};
use crate::certificate::{Purpose, Scratch, Verdict, certify};
use crate::chain::{UNTURNED, turn_joints};
use crate::choose::{Aims, Choice, Chooser, aims};
use crate::clearance::Anchor;
use crate::config::{Config, ENGAGE_MARGIN_M};
use crate::dynamics::PerJoint;
use crate::plan::{JointState, PlannedMotion};
use crate::recover::Recovery;
use crate::torque::{self, Load, TorqueScratch, TorqueVerdict};
use crate::trajectory::Trajectory;
use messages::{JOINTS_MAX, JointMotion, PayloadRefusal, Permit, Stamp, TICK_S, command_flag};
use robot::Payload;

/// A joint within this distance of its target counts as on target, rad or m. It is half the limb error that a
/// viewer can see.
const ON_TARGET: f64 = 0.01;

/// Target of the joints. Any values are accepted, even those that are not finite.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Target<'a> {
    /// Positions, rad or m.
    pub q: &'a [f64; JOINTS_MAX],
    /// Velocities, rad/s or m/s.
    pub dq: &'a [f64; JOINTS_MAX],
    /// Accelerations of the target's path, rad/s^2 or m/s^2. Zero if unknown.
    pub ddq: &'a [f64; JOINTS_MAX],
    /// Bit j is set if joint j has a target. The other joints go to the home posture.
    pub valid_mask: u32,
}

/// Input of a tick.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Input<'a> {
    /// Index of the tick.
    pub k: u64,
    /// Target of the joints. None means that they hold.
    pub target: Option<Target<'a>>,
    /// Permission for the joints to move.
    pub permit: Permit,
}

/// The joints that took a new decision. All others play the plan. Torso and head belong to no arm. They move
/// only with `All`, so that a blocked arm never moves the other one's base.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Candidate {
    /// All joints.
    All,
    /// The left arm.
    Left,
    /// The right arm.
    Right,
    /// No joint.
    Plan,
}

/// Decision of a tick: the command of tick k, complete in every case.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Output {
    /// The motion, with its certified stop.
    pub motion: JointMotion,
    /// The joints that took a new decision.
    pub candidate: Candidate,
    /// Bit j is set if joint j is at the next point of the previous plan, without a new decision.
    pub on_plan: u32,
    /// Smallest distance over the checked pairs and obstacles at this command, m.
    pub clearance_m: f64,
    /// Indices of the capsules of that pair. For an obstacle the second is the number of capsules plus its index.
    pub nearest_pair: [u32; 2],
    /// Every joint stands still.
    pub at_rest: bool,
    /// Every joint is within 0.01 rad (m) of its target. False without a target.
    pub on_target: bool,
    /// `at_rest` or `on_target`.
    pub settled: bool,
    /// Result of the program that changes the wanted jerks near other pairs.
    pub program: Program,
    /// Number of wanted motions that were not certified in this tick.
    pub fallbacks: u32,
    /// The pair that could not be certified in the first of them, as `nearest_pair`.
    pub refused_pair: Option<[u32; 2]>,
    /// Number of motions among them whose torques could not be proved.
    pub overloads: u32,
    /// The joint in the first of the `overloads`.
    pub overloaded_joint: Option<u32>,
    /// Number of evaluations of the kinematics and of the dynamics.
    pub evaluations: u32,
}

impl Output {
    /// The flags of this tick's command. If the gate `denied` it, all joints play the plan.
    pub fn command_flags(&self, denied: bool) -> u32 {
        if denied || self.candidate == Candidate::Plan { command_flag::ON_PLAN } else { 0 }
    }
}

/// State of the stage: the last command with its certified plan, and working memory.
#[derive(Clone, Debug)]
pub struct State {
    planned: JointMotion,
    anchor: Anchor,
    barrier: Barrier,
    recovery: Recovery,
    scratch: Scratch,
    torque: TorqueScratch,
    /// Masses and motors, with the payload of the hands. None if no torque is to be proved.
    load: Option<Load>,
}

impl State {
    /// Creates the state of a robot at rest at `q`.
    pub fn at_rest(config: &Config, q: [f64; JOINTS_MAX]) -> Self {
        Self {
            planned: JointMotion::rest(q),
            anchor: Anchor::new(&config.geometry, q),
            barrier: Barrier::new(&config.geometry, q),
            recovery: Recovery::new(&config.geometry, q),
            scratch: Scratch::new(&config.geometry),
            torque: TorqueScratch::new(),
            load: config.load.clone(),
        }
    }

    /// Continues from another state with its certified plan, as reported by the driver. Never allocates.
    pub fn reseed(&mut self, planned: &JointMotion) {
        self.planned = *planned;
    }

    /// Sets the payload of the hands, if the robot is at rest. Returns the joint that needs more than its
    /// share to hold the posture with it, if any. Then the stage takes no decision. Never allocates.
    ///
    /// # Errors
    /// Returns `Moving` if the last command or its plan is not at rest. Then the previous payload stays in force.
    pub fn carry(&mut self, config: &Config, payload: &[Payload; 2]) -> Result<Option<usize>, PayloadRefusal> {
        if !self.planned.is_at_rest() {
            return Err(PayloadRefusal::Moving);
        }
        let Some(load) = &mut self.load else { return Ok(None) };
        load.carry(payload);
        Ok(load.overloaded_at_rest(&config.geometry.chain, &self.planned.q).map(|(joint, ..)| joint))
    }

    /// Payload of the hands. It is empty if the configuration proves no torques.
    pub fn payload(&self) -> [Payload; 2] {
        self.load.as_ref().map_or([Payload::EMPTY; 2], |load| *load.payload())
    }

    /// Like the function `overloaded_at_rest`, but with the present payload of the hands.
    pub fn overloaded_at_rest(&self, config: &Config, q: &[f64; JOINTS_MAX]) -> Option<(usize, f64, f64)> {
        self.load.as_ref()?.overloaded_at_rest(&config.geometry.chain, q)
    }

    /// The last command with its plan.
    pub fn planned(&self) -> &JointMotion {
        &self.planned
    }
}

/// Advances the stage by one period. It is deterministic, and it never allocates, blocks, logs, reads a clock
/// or panics.
///
/// ```
/// # let read = |kind| std::fs::read_to_string(format!("../../config/robots/tiago_dual.{kind}"));
/// # let model = robot::Model::from_text("tiago_dual.toml", &read("toml")?, "tiago_dual.urdf", &read("urdf")?)?;
/// use wbc::{Config, Input, Options, Permit, State, Target, tick};
///
/// let config = Config::new(&model, Options::default())?;
/// let mut state = State::at_rest(&config, model.home);
/// let (mut q, zero) = (model.home, [0.0; messages::JOINTS_MAX]);
/// q[model.arms[0].range().start] += 0.1;
/// let target = Some(Target { q: &q, dq: &zero, ddq: &zero, valid_mask: messages::ALL_JOINTS });
/// let input = |k| Input { k, target, permit: Permit::Follow { speed_scale: 1.0 } };
/// let step = |k| tick(&config, &mut state, messages::deadline(k), input(k));
/// assert!((1..750).map(step).any(|out| out.on_target)); // Within half a second.
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
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

/// Checks that `q`, held at rest, is clear enough to engage: every pair must keep d_min and 3 mm. Returns also the
/// smallest distance (m) and the capsules of that pair. Do not call it in a tick, because it allocates.
pub fn certify_rest(config: &Config, q: &[f64; JOINTS_MAX]) -> (bool, f64, [u32; 2]) {
    let anchor = Anchor::new(&config.geometry, *q);
    let clear = anchor.clearance_m >= config.geometry.d_min_m + ENGAGE_MARGIN_M;
    (clear, anchor.clearance_m, nearest_pair(config, &anchor))
}

/// Proves that a plan keeps d_min from now to rest, whatever computed it. Do not call it in a tick, because
/// it allocates.
pub fn certify_plan(config: &Config, planned: &JointMotion) -> Verdict {
    let mut anchor = Anchor::new(&config.geometry, planned.q);
    let mut scratch = Scratch::new(&config.geometry);
    certify(
        &config.geometry,
        &Trajectory::stops(planned),
        Purpose::Decision,
        config.geometry.chain.all(),
        &mut anchor,
        &mut scratch,
    )
}

/// The joint that needs more than its share of the effort limit to hold `q` at rest, if any, with its torque
/// and the limit, N m or N. It uses the payload of the hands at the start.
pub fn overloaded_at_rest(config: &Config, q: &[f64; JOINTS_MAX]) -> Option<(usize, f64, f64)> {
    config.load.as_ref()?.overloaded_at_rest(&config.geometry.chain, q)
}

/// Torques of the links in a motion (rad, m, and seconds), N m or N. None if the configuration proves no torques.
pub fn torques(config: &Config, q: &PerJoint, v: &PerJoint, a: &PerJoint) -> Option<PerJoint> {
    let x = std::array::from_fn(|j| JointState { q: q[j], v: v[j], a: a[j] });
    config.load.as_ref().map(|load| load.torques(&config.geometry.chain, &x))
}

/// Proves that the torques of a plan keep their limits from now to rest, whatever computed it.
pub fn certify_torque(config: &Config, planned: &JointMotion) -> TorqueVerdict {
    let Some(load) = &config.load else { return TorqueVerdict { blamed: None, evaluations: 0 } };
    let mut scratch = TorqueScratch::new();
    let (chain, mut now) = (&config.geometry.chain, UNTURNED);
    turn_joints(chain, |j| planned.q[j], chain.all(), &mut now);
    torque::prove(load, chain, (&Trajectory::stops(planned), &now), chain.all(), &mut scratch)
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
    let on_target = (0..config.count()).all(|j| aims[j].is_some_and(|aim| (aim.q - next.q[j]).abs() <= ON_TARGET));
    Output {
        motion: *next,
        candidate: choice.candidate,
        on_plan: config.geometry.chain.all() & !choice.fresh,
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
