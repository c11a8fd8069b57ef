//! One period of whole-body control: what each joint would like, what it may, and what all of them together are proved
//! to survive.

use crate::certificate::{Scratch, Verdict, certify};
use crate::chain::JointSet;
use crate::clearance::Anchor;
use crate::config::{Config, ENGAGE_MARGIN_M};
use crate::interval::Bounds;
use crate::motion::{JointMotion, Motion};
use crate::plan::{JointState, JointStop, Planned};
use crate::track::{JointAim, wanted_jerk};
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
        /// Share of each joint's largest speed, (0, 1].
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
        Permit::Follow { speed_scale } => choose(config, state, &aims, speed_scale, &on_plan),
        Permit::Stop => Choice::plan(on_plan),
    };
    state.planned = choice.next;
    state.anchor.place(geometry, choice.next.q);
    output(config, state, &choice, &aims)
}

/// Whether `q`, held at rest, is clear enough to engage: every pair keeps d_min and 3 mm. Also the smallest distance (m)
/// and the capsules of that pair. Not for a tick: it allocates.
pub fn certify_rest(config: &Config, q: &[f64; JOINTS]) -> (bool, f64, [u32; 2]) {
    let anchor = Anchor::new(&config.geometry, *q);
    let clear = anchor.clearance_m >= config.geometry.d_min_m + ENGAGE_MARGIN_M;
    (clear, anchor.clearance_m, nearest_pair(config, &anchor))
}

/// Whether a plan is proved to keep d_min from now to rest, whatever it was made by. Not for a tick: it allocates.
pub fn certify_plan(config: &Config, planned: &Planned) -> Verdict {
    let anchor = Anchor::new(&config.geometry, planned.q);
    let mut scratch = Scratch::new(&config.geometry);
    certify(
        &config.geometry,
        &Motion::stops(planned),
        ALL_JOINTS,
        &anchor,
        &mut scratch,
    )
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
        Self {
            next,
            candidate: Candidate::Plan,
            fresh: 0,
            fallbacks: 0,
            evaluations: 0,
        }
    }
}

fn aims(config: &Config, input: &Input<'_>) -> Aims {
    let Some(target) = input.target else {
        return [None; JOINTS];
    };
    std::array::from_fn(|j| {
        let meant = target.valid_mask & 1 << j != 0;
        let aim = if meant {
            JointAim {
                q: target.q[j],
                dq: target.dq[j],
            }
        } else {
            JointAim {
                q: config.home[j],
                dq: 0.0,
            }
        };
        aim.within(&config.bounds[j])
    })
}

/// The first candidate that is proved.
fn choose(config: &Config, state: &mut State, aims: &Aims, speed_scale: f64, on_plan: &Planned) -> Choice {
    let scale = if speed_scale.is_finite() {
        speed_scale.clamp(0.0, 1.0)
    } else {
        0.0
    };
    let before = state.planned;
    let plan_motion = Motion::stops(&before);
    let mut choice = Choice::plan(*on_plan);
    let mut bounds = config.bounds;
    let mut jerks = [None; JOINTS];
    for j in 0..JOINTS {
        let (x, stop) = (before.joint(j), JointStop::of(&before.plan, j));
        bounds[j] = relaxed(&config.bounds[j], config.hard_range[j], scale, x, &stop);
        // The speed asked for is what the scale allows, not what the state makes unavoidable.
        let asked = Bounds {
            v_max: scale * config.bounds[j].v_max,
            ..config.bounds[j]
        };
        let wanted = aims[j].and_then(|aim| wanted_jerk(x, aim, &asked));
        jerks[j] = wanted.and_then(|wanted| bounds[j].nearest_admissible(x, wanted));
    }
    let mut blamed = ALL_JOINTS;
    for (candidate, group, step) in [
        (Candidate::All, ALL_JOINTS, STEPS[0]),
        (Candidate::All, ALL_JOINTS, STEPS[1]),
        (Candidate::Left, LEFT, STEPS[0]),
        (Candidate::Right, RIGHT, STEPS[0]),
    ] {
        // A pair that failed and that only this group moves would fail again.
        if step == STEPS[0] && blamed & !group == 0 && candidate != Candidate::All {
            continue;
        }
        let mut next = *on_plan;
        let mut motion = plan_motion.clone();
        let mut fresh = 0;
        for j in (0..JOINTS).filter(|&j| group & 1 << j != 0) {
            let Some(full) = jerks[j] else { continue };
            let x = before.joint(j);
            let Some(jerk) = stepped(&bounds[j], x, full, on_plan.a[j], step) else {
                continue;
            };
            let after = x.after(jerk, TICK_S);
            let stop = JointStop::new(after.v, after.a, bounds[j].a_max, bounds[j].j_max);
            next.set_joint(j, after, stop);
            motion.joints[j] = JointMotion::tick_then_stop(x, jerk, &stop);
            fresh |= 1 << j;
        }
        if fresh == 0 {
            continue;
        }
        let verdict = if config.certificate {
            let verdict = certify(&config.geometry, &motion, fresh, &state.anchor, &mut state.scratch);
            choice.evaluations += verdict.evaluations;
            verdict.blamed
        } else {
            None
        };
        let Some(pair) = verdict else {
            return Choice {
                next,
                candidate,
                fresh,
                ..choice
            };
        };
        blamed = config.geometry.pairs[pair].between;
        choice.fallbacks += 1;
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

/// The bounds of this tick: where the plan already reaches further than the planned range or the scaled speed (a posture
/// at its limit, a scale that fell), not beyond the plan, and never beyond the limits themselves.
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
