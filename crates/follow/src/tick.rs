//! One period of following.

use crate::arm::{Arm, ArmVector, Limbs};
use crate::gap::{Gap, Gaps, WATCHED};
use crate::plan::{Plan, intervals_s, is_finite, node_after};
use crate::proximity::ArmPairs;
use crate::solver::{self, Bounds, Problem, Sweep};
use crate::wrist::{self, Wrist};
use crate::{ITERATION_TICKS, LIMB_JOINTS, NODES};
use messages::{HAND_NODES, JOINTS_MAX, LIMBS, TICK_S, TRAJECTORY_NODE_TICKS};
use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use robot::{Frames, Model};

pub use crate::solver::Weights;

/// Both arms: left, right.
const ARMS: usize = 2;

/// If the command is farther from the plan than this (rad, and rad/s), the plan was not reached. The next
/// iteration then starts from the command. The bound is twice what the tracking law leaves without an obstacle.
const OFF_RAD: f64 = 0.02;
const OFF_RAD_PER_S: f64 = 0.3;

/// An arm is stalled if both its limbs together come nearer to the person by less than this, rad/s. The test of
/// random hanging arms chose it and the three constants below.
const STALLED_RAD_PER_S: f64 = 0.5;
/// An arm is stalled only if the proposed posture would be nearer by more than this, rad.
const STALLED_RAD: f64 = 0.2;
/// Share of the stalled time that an arm keeps in each iteration after it is no longer stalled.
const STALLED_KEPT: f64 = 0.95;
/// Longest stalled time that counts, s.
const STALLED_MAX_S: f64 = 1.0;

/// Time from one iteration of an arm to its next, s. Both arms take turns.
const EACH_S: f64 = (ARMS as u64 * ITERATION_TICKS) as f64 * TICK_S;

/// Time between two steps of a wrist, s. Both arms take turns.
const WRIST_STEP_S: f64 = (ARMS * WATCHED.len()) as f64 * TICK_S;

/// Margin to the position limits, rad. Whole-body control keeps the same.
const INSET_RAD: f64 = 1e-3;

/// Setpoint of one joint for the next tick.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Aim {
    /// Position, rad.
    pub q: f64,
    /// Velocity, rad/s.
    pub v: f64,
    /// Acceleration, rad/s^2.
    pub a: f64,
}

/// Constant configuration.
#[derive(Clone, Debug)]
pub struct Config {
    arms: [Arm; ARMS],
    /// Joints of each arm.
    joints: [robot::Arm; ARMS],
    bounds: [Bounds; ARMS],
    weights: Weights,
    wrists: [Wrist; ARMS],
    pairs: [ArmPairs; ARMS],
    model: Box<Model>,
}

impl Config {
    /// Creates a configuration for the robot's arms within their limits. `v_max`: speeds that the plan may use, rad/s.
    pub fn new(model: &Model, v_max: &[f64; JOINTS_MAX], weights: Weights) -> Self {
        let joints = model.arms;
        let bounds = joints.each_ref().map(|arm| {
            // What stands in an empty slot is no limit: nothing moves there.
            let each =
                |empty: f64, value: &dyn Fn(usize) -> f64| ArmVector::from_fn(|j, _| arm.slots[j].map_or(empty, value));
            Bounds {
                q_min: each(-1.0, &|j| model.limits[j].q_min + INSET_RAD),
                q_max: each(1.0, &|j| model.limits[j].q_max - INSET_RAD),
                v_max: each(1.0, &|j| v_max[j]),
                a_max: each(1.0, &|j| model.limits[j].a_max),
            }
        });
        let wrists = [0, 1].map(|side| Wrist::new(model, side, v_max));
        let pairs = joints.each_ref().map(|arm| ArmPairs::new(model, arm));
        let arms = [0, 1].map(|side| Arm::from_model(model, side));
        Self { arms, joints, bounds, weights, wrists, pairs, model: Box::new(model.clone()) }
    }
}

/// Input of a tick.
#[derive(Clone, Copy, Debug)]
pub struct Input<'a> {
    /// Index of the tick whose command is decided.
    pub k: u64,
    /// The person's limbs at nodes, as in the message.
    pub limb_trajectory: &'a [[[f32; 4]; LIMBS]; NODES],
    /// Tick of the first node over its spacing.
    pub trajectory_first: u64,
    /// Bit j: joint j is valid.
    pub valid_mask: u32,
    /// The posture that retargeting proposes, rad.
    pub prior: &'a [f64; JOINTS_MAX],
    /// Wanted rotations of both hands at the first nodes, as in the message. Zero for an unknown hand.
    pub hands: &'a [[[f32; 4]; ARMS]; HAND_NODES],
    /// Places of both hands at the nodes, and their weights, as in the message. A hand with a place has a shorter range R.
    pub places: &'a [[[f32; 4]; ARMS]; NODES],
    /// Commanded positions at tick k - 1.
    pub q: &'a [f64; JOINTS_MAX],
    /// Commanded velocities at tick k - 1.
    pub v: &'a [f64; JOINTS_MAX],
    /// Share of the speeds that may be used, (0, 1].
    pub speed_scale: f64,
    /// The same for the wrists.
    pub wrist_speed_scale: f64,
}

/// Result of a tick.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Output {
    /// Setpoint of each joint of an arm that is followed. `None` for the others.
    pub aims: [Option<Aim>; JOINTS_MAX],
}

/// An iteration in progress.
#[derive(Clone, Debug)]
struct Iteration {
    problem: Problem,
    sweep: Sweep,
    /// Tick at which its result is valid.
    begin: u64,
}

/// State of the following. Fixed size.
#[derive(Clone, Debug)]
pub struct State {
    plans: [Plan; ARMS],
    in_use: [bool; ARMS],
    iteration: Box<Iteration>,
    /// Next step of the iteration, and its arm.
    step: u64,
    arm: usize,
    /// Error of the limbs at the end of the last iteration's horizon, sum of both, rad.
    off_at_end_rad: [f64; ARMS],
    /// Time for which each arm has been stalled, s.
    stalled_s: [f64; ARMS],
    wrists: [wrist::WristTarget; ARMS],
    gaps: [Gaps; ARMS],
    /// Next watched node, and its arm.
    watched_step: usize,
    watched_arm: usize,
    frames: Box<Frames>,
}

/// A state at rest. It allocates its working memory, once.
impl Default for State {
    fn default() -> Self {
        let unbounded = ArmVector::repeat(1.0);
        let bounds = Bounds { q_min: -unbounded, q_max: unbounded, v_max: unbounded, a_max: unbounded };
        let problem = Problem {
            start: solver::State::default(),
            interval_s: [0.02; NODES],
            person: [Limbs::identity(); NODES],
            weight: [1.0; NODES],
            prior: ArmVector::zeros(),
            pull: 0.0,
            bounds,
            gaps: Gaps::none(),
            places: [None; NODES],
        };
        Self {
            plans: std::array::from_fn(|_| Plan::rest(0, ArmVector::zeros())),
            in_use: [false; ARMS],
            iteration: Box::new(Iteration { problem, sweep: Sweep::default(), begin: 0 }),
            step: 0,
            arm: 0,
            off_at_end_rad: [0.0; ARMS],
            stalled_s: [0.0; ARMS],
            wrists: [wrist::WristTarget::default(); ARMS],
            gaps: [Gaps::none(); ARMS],
            watched_step: 0,
            watched_arm: 0,
            frames: Box::default(),
        }
    }
}

impl State {
    /// Updates the stalled time of an arm from the error of its limbs at the end of its horizon.
    fn update_stall(&mut self, config: &Config, arm: usize) {
        let work = &*self.iteration;
        let off = |q: &ArmVector| config.arms[arm].angles(q, &work.problem.person[NODES - 1]).iter().sum::<f64>();
        let end = off(&work.sweep.nodes()[NODES - 1].q);
        let before = std::mem::replace(&mut self.off_at_end_rad[arm], end);
        let nearer = before - end >= STALLED_RAD_PER_S * EACH_S;
        let stalled = !nearer && end > off(&work.problem.prior) + STALLED_RAD;
        let time_s = if stalled { self.stalled_s[arm] + EACH_S } else { self.stalled_s[arm] * STALLED_KEPT };
        self.stalled_s[arm] = time_s.min(STALLED_MAX_S);
    }

    /// Drops the plans, because the robot does not follow. The next followed tick starts from its command.
    pub fn forget(&mut self) {
        (self.in_use, self.step, self.arm, self.stalled_s) = ([false; ARMS], 0, 0, [0.0; ARMS]);
        (self.watched_step, self.watched_arm) = (0, 0);
        self.gaps = [Gaps::none(); ARMS];
    }
}

/// Advances the stage by one period. It is deterministic, and never allocates, blocks, logs, reads a clock or panics.
///
/// ```
/// # let read = |kind| std::fs::read_to_string(format!("../../config/robots/tiago_dual.{kind}"));
/// # let model = robot::Model::from_text("tiago_dual.toml", &read("toml")?, "tiago_dual.urdf", &read("urdf")?)?;
/// use messages::{ALL_JOINTS, JOINTS_MAX, LIMBS, TRAJECTORY_NODE_TICKS};
///
/// let (home, rest, t_pose) = (&model.home, &[0.0; JOINTS_MAX], &[[[0.0, 0.0, 0.0, 1.0]; LIMBS]; follow::NODES]);
/// let config = follow::Config::new(&model, &model.limits.map(|limits| limits.v_max), follow::Weights::default());
/// let trajectory_first = 3000 / TRAJECTORY_NODE_TICKS;
/// let input = follow::Input {
///     k: 3000, limb_trajectory: t_pose, trajectory_first, valid_mask: ALL_JOINTS, prior: home, hands: &[[[0.0; 4]; 2]; 6],
///     places: &[[[0.0; 4]; 2]; follow::NODES], q: home, v: rest,
///     speed_scale: 1.0, wrist_speed_scale: 1.0,
/// };
/// let out = follow::tick(&config, &mut follow::State::default(), input);
/// assert!(out.aims[model.arms[0].range().start].is_some());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn tick(config: &Config, state: &mut State, input: Input<'_>) -> Output {
    let before = input.k.saturating_sub(1);
    for arm in 0..ARMS {
        let joints = &config.joints[arm];
        let in_use = joints.limb_joints().all(|j| input.valid_mask & 1 << j != 0);
        if in_use && !state.in_use[arm] {
            let start = solver::State { q: part(input.q, joints), v: part(input.v, joints) };
            state.plans[arm] = Plan::new(before, start, [ArmVector::zeros(); NODES]);
            state.wrists[arm] = config.wrists[arm].begin(input.q);
            // Its old gaps belong to another posture.
            state.gaps[arm] = Gaps::none();
            // An iteration that started before the arm was valid has another start.
            state.step = if state.arm == arm { 0 } else { state.step };
        }
        state.in_use[arm] = in_use;
        state.plans[arm].advance(before);
    }
    if state.in_use[state.arm] || state.step > 0 {
        iterate(config, state, &input);
    } else {
        state.arm = 1 - state.arm;
    }
    evaluate_pairs(config, state, &input);
    let mut output = Output { aims: [None; JOINTS_MAX] };
    for arm in (0..ARMS).filter(|&arm| state.in_use[arm]) {
        let u = state.plans[arm].input_at(before);
        state.plans[arm].advance(input.k);
        let there = &state.plans[arm].state;
        for (j, joint) in config.joints[arm].slots.into_iter().take(LIMB_JOINTS).enumerate() {
            let Some(joint) = joint else { continue };
            output.aims[joint] = Some(Aim { q: there.q[j], v: there.v[j], a: u[j] });
        }
        // Evaluations since the wrist's last step, as a share of those until its next step.
        let evaluations = state.watched_step + if state.watched_arm == arm { WATCHED.len() } else { 0 };
        let share = evaluations as f64 / (ARMS * WATCHED.len()) as f64;
        for (i, joint) in config.wrists[arm].joints() {
            let (q, v) = state.wrists[arm].at(i, share, WRIST_STEP_S);
            output.aims[joint] = Some(Aim { q, v, a: 0.0 });
        }
    }
    output
}

/// Evaluates the pairs of one arm at its next watched node, in the posture of both arms' plans there.
fn evaluate_pairs(config: &Config, state: &mut State, input: &Input<'_>) {
    let (arm, step) = (state.watched_arm, state.watched_step);
    let before = input.k.saturating_sub(1);
    let follows_hand = rotation(input.hands[0][arm]).is_some();
    let range_m = wrist::range_m(follows_hand, place(input.places[0][arm], arm).is_some());
    if state.in_use[arm] {
        let until = before + (WATCHED[step] as u64 + 1) * TRAJECTORY_NODE_TICKS;
        let mut q = *input.q;
        for other in (0..ARMS).filter(|&other| state.in_use[other]) {
            let plan = &state.plans[other];
            let there = plan.continued(plan.state, before, until).q;
            config.joints[other].set_limbs(&there.into(), &mut q);
            config.wrists[other].joints().for_each(|(i, joint)| q[joint] = state.wrists[other].q[i]);
        }
        config.model.forward(&q, &mut state.frames);
        let there = part(&q, &config.joints[arm]);
        let (gaps, wrist) = (&mut state.gaps[arm], &mut state.wrists[arm]);
        gaps.clear(step);
        config.pairs[arm].evaluate(&config.model, &state.frames, |pair| {
            // A joint that turns a limb changes the distance.
            if pair.slope[..LIMB_JOINTS].iter().any(|slope| *slope != 0.0) {
                let slope = ArmVector::from_fn(|j, _| pair.slope[j]);
                gaps.insert(step, Gap::new(pair.distance_m - config.model.d_min_m, slope, &there));
            }
            wrist.add(pair, range_m);
        });
    }
    state.watched_step += 1;
    if state.watched_step == WATCHED.len() {
        let speed = follows_hand.then(|| hand_speed(config, state, input, arm));
        config.wrists[arm].step(&mut state.wrists[arm], speed, input.wrist_speed_scale, WRIST_STEP_S);
        (state.watched_step, state.watched_arm) = (0, 1 - arm);
    }
}

/// Returns the wrist speed that fits the person's hand at the known nodes, rad/s.
fn hand_speed(config: &Config, state: &State, input: &Input<'_>, arm: usize) -> Vector3<f64> {
    let (plan, wrist) = (&state.plans[arm], &state.wrists[arm]);
    let (mut there, mut k) = (plan.state, input.k.saturating_sub(1));
    let mut fit = wrist::SpeedFit::default();
    for (i, hands) in input.hands.iter().enumerate() {
        let at = input.trajectory_first.saturating_add(i as u64).saturating_mul(TRAJECTORY_NODE_TICKS);
        (there, k) = (plan.continued(there, k, at), k.max(at));
        if let Some(hand) = rotation(hands[arm]) {
            let wanted = config.wrists[arm].pointing(&there.q, &hand, wrist.q);
            fit.add(wrist, at.saturating_sub(input.k) as f64 * TICK_S, wanted);
        }
    }
    fit.speed()
}

/// Runs a step of the current iteration: the first one prepares it, the last one ends it, those between sweep backward.
fn iterate(config: &Config, state: &mut State, input: &Input<'_>) {
    let arm = state.arm;
    let work = &mut *state.iteration;
    let sweeps = ITERATION_TICKS - 2;
    if state.step == 0 {
        let pull = config.weights.pull * (1.0 + config.weights.patience * state.stalled_s[arm]);
        work.problem.pull = pull * state.off_at_end_rad[arm];
        prepare(config, work, (&state.plans[arm], &state.gaps[arm]), input, arm);
    } else if state.step <= sweeps {
        let share = NODES / sweeps as usize;
        let from = NODES - (state.step as usize - 1) * share;
        for i in (from - share..from).rev() {
            work.sweep.backward(&config.arms[arm], &config.weights, &work.problem, i);
        }
    } else {
        work.sweep.finish(&config.arms[arm], &config.weights, &work.problem);
        let before = input.k.saturating_sub(1);
        let mut plan = Plan::new(work.begin, work.problem.start, work.sweep.input);
        plan.advance(before);
        if before > work.begin {
            // In missed ticks the previous plan continued.
            plan = Plan::new(before, state.plans[arm].state, plan.inputs_from(before));
        }
        if state.in_use[arm] && is_finite(&plan.state) {
            state.plans[arm] = plan;
        }
        state.update_stall(config, arm);
    }
    state.step = (state.step + 1) % ITERATION_TICKS;
    if state.step == 0 {
        state.arm = 1 - arm;
    }
}

/// Prepares the problem for the end of the iteration. It starts from the state then: on the plan or, if the plan
/// was not reached, continued from the command.
fn prepare(config: &Config, work: &mut Iteration, (plan, gaps): (&Plan, &Gaps), input: &Input<'_>, arm: usize) {
    let before = input.k.saturating_sub(1);
    work.begin = before + ITERATION_TICKS - 1;
    let commanded = solver::State { q: part(input.q, &config.joints[arm]), v: part(input.v, &config.joints[arm]) };
    let off = (commanded.q - plan.state.q).amax() > OFF_RAD || (commanded.v - plan.state.v).amax() > OFF_RAD_PER_S;
    let from = if off { commanded } else { plan.state };
    let bounds = &config.bounds[arm];
    let problem = &mut work.problem;
    problem.start = plan.continued(from, before, work.begin);
    problem.interval_s = intervals_s(work.begin);
    problem.bounds = Bounds { v_max: bounds.v_max * input.speed_scale, ..*bounds };
    problem.gaps = *gaps;
    problem.prior = part(input.prior, &config.joints[arm]);
    let first = node_after(work.begin);
    let mut known = config.arms[arm].limbs(&problem.start.q);
    for i in 0..NODES {
        let node = ((first + i as u64).saturating_sub(input.trajectory_first) as usize).min(NODES - 1);
        // Limbs that are no rotation are replaced by those of the previous node, and at the first node by the
        // arm's own.
        known = limbs(&input.limb_trajectory[node], arm).unwrap_or(known);
        problem.person[i] = known;
        problem.places[i] = place(input.places[node][arm], arm);
    }
    work.sweep.input = plan.inputs_from(work.begin);
    work.sweep.begin(&config.arms[arm], &config.weights, problem);
}

fn part(all: &[f64; JOINTS_MAX], arm: &robot::Arm) -> ArmVector {
    arm.limb_values(all).into()
}

/// Returns the limbs of an arm, mirrored to a left arm.
fn limbs(node: &[[f32; 4]; LIMBS], arm: usize) -> Option<Limbs> {
    let left = |limb: [f32; 4]| {
        let [x, y, z, w] = limb;
        // The mirror image at the plane between left and right.
        rotation(if arm == 0 { limb } else { [-x, y, -z, w] })
    };
    left(node[2 * arm]).zip(left(node[2 * arm + 1])).map(|(upper, fore)| Limbs { upper, fore })
}

/// Returns the place of an arm's hand, as that of a left arm, and its weight. `None` for no weight and for what is not finite.
fn place([x, y, z, weight]: [f32; 4], arm: usize) -> Option<(Vector3<f64>, f64)> {
    let place = Vector3::new(x, if arm == 0 { y } else { -y }, z).cast::<f64>();
    (weight > 0.0 && weight <= 1.0 && place.iter().all(|x| x.is_finite())).then_some((place, f64::from(weight)))
}

/// Returns the rotation of a message. `None` for zero and for what is not finite.
fn rotation(xyzw: [f32; 4]) -> Option<UnitQuaternion<f64>> {
    let [x, y, z, w] = xyzw.iter().all(|x| x.is_finite()).then(|| xyzw.map(f64::from))?;
    UnitQuaternion::try_new(Quaternion::new(w, x, y, z), 0.5)
}

#[cfg(test)]
mod tests {
    use super::*;
    use messages::ALL_JOINTS;

    fn model() -> Model {
        let toml = include_str!("../../../config/robots/tiago_dual.toml");
        let urdf = include_str!("../../../config/robots/tiago_dual.urdf");
        Model::from_text("toml", toml, "urdf", urdf).unwrap()
    }

    #[test]
    fn arm_that_becomes_valid_again_has_no_old_gap() {
        let model = model();
        let config = Config::new(&model, &model.limits.map(|limits| limits.v_max), Weights::default());
        let (trajectory, rest) = ([[[0.0, 0.0, 0.0, 1.0]; LIMBS]; NODES], [0.0; JOINTS_MAX]);
        let input = |k: u64, valid_mask: u32| Input {
            k,
            limb_trajectory: &trajectory,
            trajectory_first: k / TRAJECTORY_NODE_TICKS,
            valid_mask,
            prior: &model.home,
            hands: &[[[0.0; 4]; ARMS]; HAND_NODES],
            places: &[[[0.0; 4]; ARMS]; NODES],
            q: &model.home,
            v: &rest,
            speed_scale: 1.0,
            wrist_speed_scale: 1.0,
        };
        let mut state = State::default();
        tick(&config, &mut state, input(3000, ALL_JOINTS));
        tick(&config, &mut state, input(3001, 0));
        for arm in 0..ARMS {
            state.gaps[arm].insert(3, Gap::new(-0.1, ArmVector::repeat(1.0), &ArmVector::zeros()));
        }
        // One tick evaluates one node of one arm, and not this one.
        tick(&config, &mut state, input(3002, ALL_JOINTS));
        for arm in 0..ARMS {
            assert!(state.gaps[arm].at_node(WATCHED[3]).is_empty(), "arm {arm}");
        }
    }
}
