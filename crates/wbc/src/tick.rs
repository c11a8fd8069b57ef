//! One period of whole-body control: what each joint would like, what it may, and what all of them together are proved
//! to survive.

use crate::certificate::{Scratch, Verdict, certify};
use crate::chain::JointSet;
use crate::clearance::Anchor;
use crate::config::{Config, ENGAGE_MARGIN_M};
use crate::interval::Bounds;
use crate::motion::{JointMotion, Motion};
use crate::plan::{JointState, JointStop, Planned};
use crate::slide::{ROWS_MAX, Rows};
use crate::track::{JointAim, wanted_jerk, wanted_velocity};
use messages::{ALL_JOINTS, JOINTS, LEFT_ARM, RIGHT_ARM, Stamp, StopPlan, TICK_S};

/// Share of the way from the plan's jerk to the wanted one that the first candidate is tried with. The share 0 is the
/// plan itself, which needs no proof.
const STEPS: [f64; 2] = [1.0, 0.4];
/// A joint within this of its target counts as on target, rad or m; half the limb error that a viewer can see.
const ON_TARGET: f64 = 0.01;

const LEFT: JointSet = bits(LEFT_ARM.start, LEFT_ARM.end);
const RIGHT: JointSet = bits(RIGHT_ARM.start, RIGHT_ARM.end);

const fn bits(from: usize, to: usize) -> JointSet {
    ((1 << to) - 1) & !((1 << from) - 1)
}

/// Where the joints should be; any values, not even finite ones are required.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Target<'a> {
    /// Positions, rad or m.
    pub q: &'a [f64; JOINTS],
    /// Velocities, rad/s or m/s.
    pub dq: &'a [f64; JOINTS],
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
    /// Smallest distance of the checked pairs at this command, m.
    pub clearance_m: f64,
    /// Indices of the capsules of that pair.
    pub nearest_pair: [u32; 2],
    /// Every joint stands still.
    pub at_rest: bool,
    /// Every joint is within 0.01 rad (m) of its target; false without one.
    pub on_target: bool,
    /// `at_rest` or `on_target`.
    pub settled: bool,
    /// Motions that were wanted but not certified in this tick.
    pub fallbacks: u32,
    /// Evaluations of the kinematics.
    pub evaluations: u32,
}

/// Everything that the stage remembers: the last command with its certified plan, and working memory.
#[derive(Clone, Debug)]
pub struct State {
    planned: Planned,
    anchor: Anchor,
    scratch: Scratch,
}

impl State {
    /// At rest at `q`.
    pub fn at_rest(config: &Config, q: [f64; JOINTS]) -> Self {
        Self {
            planned: Planned::at_rest(q),
            anchor: Anchor::new(&config.geometry, q),
            scratch: Scratch::new(&config.geometry),
        }
    }

    /// Continues from another state with its certified plan: what the driver says it executes. Never allocates.
    pub fn reseed(&mut self, planned: &Planned) {
        self.planned = *planned;
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
            choose(config, state, &aims, speed_scale.min(1.0), &on_plan)
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
    certify(&config.geometry, &Motion::stops(planned), ALL_JOINTS, &anchor, &mut scratch)
}

/// What the joints should do: per joint an aim, none to hold.
type Aims = [Option<JointAim>; JOINTS];

/// A decision, certified.
struct Choice {
    next: Planned,
    candidate: Candidate,
    fresh: JointSet,
    fallbacks: u32,
    evaluations: u32,
}

impl Choice {
    fn plan(next: Planned) -> Self {
        Self { next, candidate: Candidate::Plan, fresh: 0, fallbacks: 0, evaluations: 0 }
    }

    /// The pair for which an attempt could not be proved, if any.
    fn try_out(&mut self, config: &Config, state: &mut State, attempt: &Attempt) -> Option<usize> {
        if !config.certificate {
            return None;
        }
        let verdict = certify(&config.geometry, &attempt.motion, attempt.fresh, &state.anchor, &mut state.scratch);
        self.evaluations += verdict.evaluations;
        self.fallbacks += u32::from(verdict.blamed.is_some());
        verdict.blamed
    }

    fn taken(self, attempt: &Attempt, candidate: Candidate) -> Self {
        // Without a new decision it is the plan, whatever it was called.
        let candidate = if attempt.fresh == 0 { Candidate::Plan } else { candidate };
        Self { next: attempt.next, candidate, fresh: attempt.fresh, ..self }
    }
}

fn aims(config: &Config, input: &Input<'_>) -> Aims {
    let Some(target) = input.target else {
        return [None; JOINTS];
    };
    std::array::from_fn(|j| {
        let meant = target.valid_mask & 1 << j != 0;
        let aim =
            if meant { JointAim { q: target.q[j], dq: target.dq[j] } } else { JointAim { q: config.home[j], dq: 0.0 } };
        aim.within(&config.bounds[j])
    })
}

/// What the candidates of one tick are made from.
struct Wishes {
    /// Bounds of this tick, and the same with the scaled speed.
    bounds: [Bounds; JOINTS],
    asked: [Bounds; JOINTS],
    /// Wanted velocities; none: the joint plays its plan.
    velocity: [Option<f64>; JOINTS],
    /// Admissible jerks.
    jerks: [Option<f64>; JOINTS],
}

impl Wishes {
    fn new(config: &Config, before: &Planned, aims: &Aims, scale: f64) -> Self {
        let mut wishes =
            Self { bounds: config.bounds, asked: config.bounds, velocity: [None; JOINTS], jerks: [None; JOINTS] };
        for j in 0..JOINTS {
            let (x, stop) = (before.joint(j), JointStop::of(&before.plan, j));
            wishes.bounds[j] = relaxed(&config.bounds[j], config.hard_range[j], scale, x, &stop);
            // The speed asked for is what the scale allows, not what the state makes unavoidable.
            wishes.asked[j].v_max = scale * config.bounds[j].v_max;
            wishes.velocity[j] = aims[j].and_then(|aim| wanted_velocity(x, aim, &wishes.asked[j]));
        }
        let velocity = wishes.velocity;
        wishes.follow(before, &velocity);
        wishes
    }

    fn follow(&mut self, before: &Planned, velocity: &[Option<f64>; JOINTS]) {
        for j in 0..JOINTS {
            let x = before.joint(j);
            let wanted = velocity[j].map(|v| wanted_jerk(x, v, &self.asked[j]));
            self.jerks[j] = wanted.and_then(|wanted| self.bounds[j].nearest_admissible(x, wanted));
        }
    }

    /// The same wishes, slid along the rows. Joints without a target stay on their plan.
    fn slid(&self, config: &Config, before: &Planned, aims: &Aims, rows: &Rows) -> Self {
        let mut v = self.velocity.map(|v| v.unwrap_or(0.0));
        rows.slide(config, &mut v);
        let velocity = std::array::from_fn(|j| {
            let v_max = self.asked[j].v_max;
            aims[j].map(|_| v[j].clamp(-v_max, v_max))
        });
        let mut slid = Self { ..*self };
        slid.follow(before, &velocity);
        slid
    }
}

/// One attempt: a group of joints takes jerks, the others play the plan.
struct Attempt {
    next: Planned,
    motion: Motion,
    fresh: JointSet,
}

impl Attempt {
    fn new(wishes: &Wishes, before: &Planned, on_plan: &Planned, group: JointSet, step: f64) -> Self {
        let mut attempt = Self { next: *on_plan, motion: Motion::stops(before), fresh: 0 };
        for j in (0..JOINTS).filter(|&j| group & 1 << j != 0) {
            let (x, bounds) = (before.joint(j), &wishes.bounds[j]);
            let Some(full) = wishes.jerks[j] else { continue };
            let Some(jerk) = stepped(bounds, x, full, on_plan.a[j], step) else {
                continue;
            };
            let after = x.after(jerk, TICK_S);
            let stop = JointStop::new(after.v, after.a, bounds.a_max, bounds.j_max);
            attempt.next.set_joint(j, after, stop);
            attempt.motion.joints[j] = JointMotion::tick_then_stop(x, jerk, &stop);
            attempt.fresh |= 1 << j;
        }
        attempt
    }
}

/// The first candidate that is proved: all joints as they wish, at a smaller step, slid along what was in the way; then
/// each arm alone; then the plan.
fn choose(config: &Config, state: &mut State, aims: &Aims, scale: f64, on_plan: &Planned) -> Choice {
    let before = state.planned;
    let wishes = Wishes::new(config, &before, aims, scale);
    let mut choice = Choice::plan(*on_plan);
    let mut rows = Rows::NONE;
    let mut blamed = None;
    for step in STEPS {
        let attempt = Attempt::new(&wishes, &before, on_plan, ALL_JOINTS, step);
        blamed = choice.try_out(config, state, &attempt);
        let Some(pair) = blamed else {
            return choice.taken(&attempt, Candidate::All);
        };
        rows.add(config, &state.anchor, pair);
    }
    let first = blamed;
    for _ in 0..ROWS_MAX {
        let slid = wishes.slid(config, &before, aims, &rows);
        let attempt = Attempt::new(&slid, &before, on_plan, ALL_JOINTS, 1.0);
        let Some(pair) = choice.try_out(config, state, &attempt) else {
            return choice.taken(&attempt, Candidate::All);
        };
        if !rows.add(config, &state.anchor, pair) {
            break;
        }
    }
    for (candidate, group) in [(Candidate::Left, LEFT), (Candidate::Right, RIGHT)] {
        // A pair that failed and that only this group moves would fail again.
        if first.is_some_and(|pair| config.geometry.pairs[pair].between & !group == 0) {
            continue;
        }
        let attempt = Attempt::new(&wishes, &before, on_plan, group, 1.0);
        if attempt.fresh != 0 && choice.try_out(config, state, &attempt).is_none() {
            return choice.taken(&attempt, candidate);
        }
    }
    choice
}

/// The jerk at share `step` of the way from the plan's mean jerk over the tick to the `full` one.
fn stepped(bounds: &Bounds, x: JointState, full: f64, plan_a: f64, step: f64) -> Option<f64> {
    if step == 1.0 {
        return Some(full);
    }
    let plan = (plan_a - x.a) / TICK_S;
    bounds.nearest_admissible(x, plan + step * (full - plan))
}

/// The bounds of this tick: where the plan already reaches further than the planned range or the scaled speed (a
/// posture at its limit, a scale that fell), not beyond the plan, and never beyond the limits themselves.
fn relaxed(nominal: &Bounds, hard: [f64; 2], scale: f64, x: JointState, stop: &JointStop) -> Bounds {
    let fastest = x.v.abs().max(x.coasting_velocity(nominal.j_max).abs());
    let (low, high) = stop.extremes(x);
    Bounds {
        q_min: nominal.q_min.min(low.max(hard[0])),
        q_max: nominal.q_max.max(high.min(hard[1])),
        v_max: (scale * nominal.v_max).max(fastest.min(nominal.v_max)),
        ..*nominal
    }
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
        fallbacks: choice.fallbacks,
        evaluations: choice.evaluations,
    }
}
