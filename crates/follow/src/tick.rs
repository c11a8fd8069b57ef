//! One period of following.

use crate::arm::{Arm, ArmVector, Limbs};
use crate::plan::{Plan, intervals_s, is_finite, node_after};
use crate::solver::{self, Bounds, Problem, Sweep};
use crate::{ITERATION_TICKS, LIMB_JOINTS, NODES};
use messages::{JOINTS, LEFT_ARM, LIMBS, RIGHT_ARM, TICK_S};
use nalgebra::{Quaternion, UnitQuaternion};
use robot::Model;

pub use crate::solver::Weights;

/// Both arms: left, right.
const ARMS: usize = 2;
/// The first joint of each arm.
const FIRST: [usize; ARMS] = [LEFT_ARM.start, RIGHT_ARM.start];

/// A wish that is farther than this from what is commanded (rad, and rad/s) has not come true: the next iteration begins
/// from the command. Twice what the tracking law leaves where nothing is in the way.
const OFF_RAD: f64 = 0.02;
const OFF_RAD_PER_S: f64 = 0.3;

/// The limbs of a stalled arm come nearer to the person by less than this, both together, rad/s. Chosen with the three below by
/// the test of random arms that hang.
const STALLED_RAD_PER_S: f64 = 0.5;
/// The proposed posture of a stalled arm would be nearer by more than this, rad.
const STALLED_RAD: f64 = 0.2;
/// Share of the stalled time that an arm keeps in each iteration once it is not stalled.
const STALLED_KEPT: f64 = 0.95;
/// Longest stalled time that counts, s.
const STALLED_MAX_S: f64 = 1.0;

/// Time from one iteration of an arm to its next, s: both take turns.
const EACH_S: f64 = (ARMS as u64 * ITERATION_TICKS) as f64 * TICK_S;

/// Distance kept from position limits, rad: what whole-body control keeps as well.
const INSET_RAD: f64 = 1e-3;

/// What one joint should do in the next tick.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Aim {
    /// Position, rad.
    pub q: f64,
    /// Velocity, rad/s.
    pub v: f64,
    /// Acceleration, rad/s^2.
    pub a: f64,
}

/// Everything that does not change.
#[derive(Clone, Debug)]
pub struct Config {
    arm: Arm,
    bounds: [Bounds; ARMS],
    weights: Weights,
}

impl Config {
    /// Following with the robot's arms within their limits, and within a share of their speeds.
    pub fn new(model: &Model, speed_share: f64, weights: Weights) -> Self {
        let bounds = FIRST.map(|first| {
            let of = |limit: fn(&robot::JointLimits) -> f64| ArmVector::from_fn(|j, _| limit(&model.limits[first + j]));
            Bounds {
                q_min: of(|l| l.q_min + INSET_RAD),
                q_max: of(|l| l.q_max - INSET_RAD),
                v_max: of(|l| l.v_max) * speed_share,
                a_max: of(|l| l.a_max),
            }
        });
        Self { arm: Arm::of(model), bounds, weights }
    }
}

/// What a tick is given.
#[derive(Clone, Copy, Debug)]
pub struct Input<'a> {
    /// Index of the tick whose command is decided.
    pub k: u64,
    /// The person's limbs at nodes, as the message has them.
    pub way: &'a [[[f32; 4]; LIMBS]; NODES],
    /// The tick of the first node over its spacing.
    pub way_first: u64,
    /// Bit j: joint j is meant.
    pub valid_mask: u32,
    /// The posture that retargeting proposes, rad.
    pub prior: &'a [f64; JOINTS],
    /// What is commanded, at tick k - 1: positions and velocities.
    pub q: &'a [f64; JOINTS],
    /// Velocities.
    pub v: &'a [f64; JOINTS],
    /// Share of the speeds that may be used, (0, 1].
    pub speed_scale: f64,
}

/// What a tick results in.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Output {
    /// Per joint what it should do; none for a joint that is not followed here.
    pub aims: [Option<Aim>; JOINTS],
}

/// An iteration in progress.
#[derive(Clone, Debug)]
struct Iteration {
    problem: Problem,
    sweep: Sweep,
    /// The tick at which its result holds.
    begin: u64,
}

/// Everything remembered. Fixed size.
#[derive(Clone, Debug)]
pub struct State {
    plans: [Plan; ARMS],
    meant: [bool; ARMS],
    iteration: Box<Iteration>,
    /// Step of the iteration that is next, and whose it is.
    step: u64,
    arm: usize,
    /// How far the limbs are off where the last iteration ends, sum of both, rad.
    off_at_end_rad: [f64; ARMS],
    /// How long each arm has been stalled, s.
    stalled_s: [f64; ARMS],
}

impl State {
    /// At rest. Allocates its working memory, once.
    pub fn new() -> Self {
        let nothing = solver::State { q: ArmVector::zeros(), v: ArmVector::zeros() };
        let unbounded = ArmVector::repeat(1.0);
        let bounds = Bounds { q_min: -unbounded, q_max: unbounded, v_max: unbounded, a_max: unbounded };
        let problem = Problem {
            start: nothing,
            interval_s: [0.02; NODES],
            person: [Limbs::identity(); NODES],
            weight: [1.0; NODES],
            prior: ArmVector::zeros(),
            pull: 0.0,
            bounds,
        };
        Self {
            plans: std::array::from_fn(|_| Plan::rest(0, ArmVector::zeros())),
            meant: [false; ARMS],
            iteration: Box::new(Iteration { problem, sweep: Sweep::default(), begin: 0 }),
            step: 0,
            arm: 0,
            off_at_end_rad: [0.0; ARMS],
            stalled_s: [0.0; ARMS],
        }
    }

    /// Notes how far the arm's limbs are off where its iteration ends, and whether they come no nearer.
    fn judge_progress(&mut self, config: &Config, arm: usize) {
        let work = &*self.iteration;
        let off = |q: &ArmVector| config.arm.angles(q, &work.problem.person[NODES - 1]).iter().sum::<f64>();
        let end = off(&work.sweep.nodes()[NODES - 1].q);
        let before = std::mem::replace(&mut self.off_at_end_rad[arm], end);
        let nearer = before - end >= STALLED_RAD_PER_S * EACH_S;
        let stalled = !nearer && end > off(&work.problem.prior) + STALLED_RAD;
        let time_s = if stalled { self.stalled_s[arm] + EACH_S } else { self.stalled_s[arm] * STALLED_KEPT };
        self.stalled_s[arm] = time_s.min(STALLED_MAX_S);
    }

    /// Forgets the plans: the robot does not follow. The next tick begins from what is commanded then.
    pub fn forget(&mut self) {
        (self.meant, self.step, self.arm, self.stalled_s) = ([false; ARMS], 0, 0, [0.0; ARMS]);
    }
}

impl Default for State {
    fn default() -> Self {
        Self::new()
    }
}

/// Advances the stage by one period. Deterministic; never allocates, blocks, logs, reads a clock or panics.
pub fn tick(config: &Config, state: &mut State, input: Input<'_>) -> Output {
    let before = input.k.saturating_sub(1);
    for arm in 0..ARMS {
        let meant = (0..LIMB_JOINTS).all(|j| input.valid_mask & 1 << (FIRST[arm] + j) != 0);
        if meant && !state.meant[arm] {
            let start = solver::State { q: part(input.q, arm), v: part(input.v, arm) };
            state.plans[arm] = Plan::new(before, start, [ArmVector::zeros(); NODES]);
            // An iteration from before it was meant begins elsewhere.
            state.step = if state.arm == arm { 0 } else { state.step };
        }
        state.meant[arm] = meant;
        state.plans[arm].advance(before);
    }
    if state.meant[state.arm] || state.step > 0 {
        iterate(config, state, &input);
    } else {
        state.arm = 1 - state.arm;
    }
    let mut output = Output { aims: [None; JOINTS] };
    for arm in (0..ARMS).filter(|&arm| state.meant[arm]) {
        let u = state.plans[arm].input_at(before);
        state.plans[arm].advance(input.k);
        let there = &state.plans[arm].state;
        for j in 0..LIMB_JOINTS {
            output.aims[FIRST[arm] + j] = Some(Aim { q: there.q[j], v: there.v[j], a: u[j] });
        }
    }
    output
}

/// A step of the iteration in progress: the first one prepares it, the last one ends it, those between sweep backward.
fn iterate(config: &Config, state: &mut State, input: &Input<'_>) {
    let arm = state.arm;
    let work = &mut *state.iteration;
    let sweeps = ITERATION_TICKS - 2;
    if state.step == 0 {
        let pull = config.weights.pull * (1.0 + config.weights.patience * state.stalled_s[arm]);
        work.problem.pull = pull * state.off_at_end_rad[arm];
        prepare(config, work, &state.plans[arm], input, arm);
    } else if state.step <= sweeps {
        let share = NODES / sweeps as usize;
        let from = NODES - (state.step as usize - 1) * share;
        for i in (from - share..from).rev() {
            work.sweep.backward(&config.arm, &config.weights, &work.problem, i);
        }
    } else {
        work.sweep.finish(&config.arm, &config.weights, &work.problem);
        let before = input.k.saturating_sub(1);
        let mut plan = Plan::new(work.begin, work.problem.start, work.sweep.input);
        plan.advance(before);
        if before > work.begin {
            // Ticks were missed, in which the plan before went on.
            plan = Plan::new(before, state.plans[arm].state, plan.inputs_from(before));
        }
        if state.meant[arm] && is_finite(&plan.state) {
            state.plans[arm] = plan;
        }
        state.judge_progress(config, arm);
    }
    state.step = (state.step + 1) % ITERATION_TICKS;
    if state.step == 0 {
        state.arm = 1 - arm;
    }
}

/// The problem as it will be when the iteration ends: the state then, on the plan or, where the wish did not come true,
/// continued from the command.
fn prepare(config: &Config, work: &mut Iteration, plan: &Plan, input: &Input<'_>, arm: usize) {
    let before = input.k.saturating_sub(1);
    work.begin = before + ITERATION_TICKS - 1;
    let commanded = solver::State { q: part(input.q, arm), v: part(input.v, arm) };
    let off = (commanded.q - plan.state.q).amax() > OFF_RAD || (commanded.v - plan.state.v).amax() > OFF_RAD_PER_S;
    let from = if off { commanded } else { plan.state };
    let bounds = &config.bounds[arm];
    let problem = &mut work.problem;
    problem.start = plan.continued(from, before, work.begin);
    problem.interval_s = intervals_s(work.begin);
    problem.bounds = Bounds { v_max: bounds.v_max * input.speed_scale, ..*bounds };
    problem.prior = part(input.prior, arm);
    let first = node_after(work.begin);
    let mut known = config.arm.limbs(&problem.start.q);
    for i in 0..NODES {
        let node = ((first + i as u64).saturating_sub(input.way_first) as usize).min(NODES - 1);
        // In place of what is no rotation stands the node before, and before the first one the arm as it is.
        known = limbs(&input.way[node], arm).unwrap_or(known);
        problem.person[i] = known;
    }
    work.sweep.input = plan.inputs_from(work.begin);
    work.sweep.begin(&config.arm, &config.weights, problem);
}

fn part(all: &[f64; JOINTS], arm: usize) -> ArmVector {
    ArmVector::from_fn(|j, _| all[FIRST[arm] + j])
}

/// The limbs of an arm as those of a left arm.
fn limbs(node: &[[f32; 4]; LIMBS], arm: usize) -> Option<Limbs> {
    let rotation = |limb: [f32; 4]| {
        let [x, y, z, w] = limb.map(f64::from);
        // The mirror image at the plane between left and right.
        let (x, z) = if arm == 0 { (x, z) } else { (-x, -z) };
        UnitQuaternion::try_new(Quaternion::new(w, x, y, z), 0.5)
    };
    rotation(node[2 * arm]).zip(rotation(node[2 * arm + 1])).map(|(upper, fore)| Limbs { upper, fore })
}
