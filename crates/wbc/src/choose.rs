//! The decision of one tick: what each joint would like, what it may, and the first candidate that is proved.

use crate::barrier::{Barrier, Program, Wish};
use crate::certificate::{Purpose, Scratch, certify};
use crate::chain::JointSet;
use crate::clearance::Anchor;
use crate::config::Config;
use crate::interval::Bounds;
use crate::motion::{JointMotion, Motion};
use crate::plan::{JointState, JointStop, Planned};
use crate::tick::{Candidate, Input};
use crate::track::{JointAim, wanted_jerk, wanted_velocity};
use messages::{ALL_JOINTS, JOINTS, LEFT_ARM, RIGHT_ARM, TICK_S, known_bug};

/// Share of the way from the plan's jerk to the wanted one that a candidate is tried with. The share 0 is the plan
/// itself, which needs no proof.
const STEPS: [f64; 2] = [1.0, 0.4];

/// What a speed may exceed the scale's by without counting as faster: rounding, of which a tick adds 1e-15.
const SCALE_ROUNDING: f64 = 1e-9;

const LEFT: JointSet = bits(LEFT_ARM.start, LEFT_ARM.end);
const RIGHT: JointSet = bits(RIGHT_ARM.start, RIGHT_ARM.end);

const fn bits(from: usize, to: usize) -> JointSet {
    ((1 << to) - 1) & !((1 << from) - 1)
}

/// What the joints should do: per joint an aim, none to hold.
pub(crate) type Aims = [Option<JointAim>; JOINTS];

/// A decision, certified.
pub(crate) struct Choice {
    pub(crate) next: Planned,
    pub(crate) candidate: Candidate,
    pub(crate) fresh: JointSet,
    pub(crate) program: Program,
    pub(crate) fallbacks: u32,
    /// The pair for which the first motion of this decision that was wanted could not be proved.
    pub(crate) refused: Option<usize>,
    pub(crate) evaluations: u32,
}

impl Choice {
    pub(crate) fn plan(next: Planned) -> Self {
        Self {
            next,
            candidate: Candidate::Plan,
            fresh: 0,
            program: Program::Idle,
            fallbacks: 0,
            refused: None,
            evaluations: 0,
        }
    }

    fn taken(self, attempt: &Attempt, candidate: Candidate) -> Self {
        // Without a new decision it is the plan, whatever it was called.
        let candidate = if attempt.fresh == 0 { Candidate::Plan } else { candidate };
        Self { next: attempt.next, candidate, fresh: attempt.fresh, ..self }
    }
}

/// Per joint the aim of this tick, within its limits.
pub(crate) fn aims(config: &Config, input: &Input<'_>) -> Aims {
    let Some(target) = input.target else {
        return [None; JOINTS];
    };
    std::array::from_fn(|j| {
        let meant = target.valid_mask & 1 << j != 0;
        let aim =
            if meant { JointAim { q: target.q[j], dq: target.dq[j] } } else { JointAim { q: config.home[j], dq: 0.0 } };
        let degrees = known_bug!(DegreesForOneJoint) && j == LEFT_ARM.start + 1;
        let aim = if degrees { JointAim { q: aim.q.to_radians(), ..aim } } else { aim };
        aim.within(&config.bounds[j])
    })
}

/// What every joint would like at a share `scale` of its speed; none: it plays its plan.
fn wishes(config: &Config, before: &Planned, aims: &Aims, scale: f64) -> [Option<Wish>; JOINTS] {
    std::array::from_fn(|j| {
        let (x, stop) = (before.joint(j), JointStop::of(&before.plan, j));
        let bounds = relaxed(&config.bounds[j], config.hard_range[j], scale, x, &stop);
        // The speed asked for is what the scale allows, not what the state makes unavoidable.
        let asked = Bounds { v_max: scale * config.bounds[j].v_max, ..config.bounds[j] };
        let fastest = x.v.abs().max(x.coasting_velocity(asked.j_max).abs());
        if fastest > asked.v_max * (1.0 + SCALE_ROUNDING) && x.v * x.a > 0.0 {
            // Too fast for a scale that fell, and still gaining: nothing brakes sooner than the plan.
            return None;
        }
        let velocity = wanted_velocity(x, aims[j]?, &asked)?;
        let wanted = wanted_jerk(x, velocity, &asked);
        let jerk = bounds.nearest_admissible(x, wanted)?;
        Some(Wish { x, bounds, wanted, jerk })
    })
}

/// One attempt: a group of joints takes jerks, the others play the plan.
struct Attempt {
    next: Planned,
    motion: Motion,
    fresh: JointSet,
}

impl Attempt {
    fn new(wishes: &[Option<Wish>; JOINTS], plan: &Motion, on_plan: &Planned, group: JointSet, step: f64) -> Self {
        let mut attempt = Self { next: *on_plan, motion: plan.clone(), fresh: 0 };
        for j in (0..JOINTS).filter(|&j| group & 1 << j != 0) {
            let Some(wish) = &wishes[j] else { continue };
            let Some(jerk) = stepped(wish, on_plan.a[j], step) else { continue };
            let (after, stop) = wish.tick(jerk);
            attempt.next.set_joint(j, after, stop);
            attempt.motion.joints[j] = JointMotion::tick_then_stop(wish.x, jerk, &stop);
            attempt.fresh |= 1 << j;
        }
        attempt
    }
}

/// The stages of a decision, with the memory that they work in.
pub(crate) struct Chooser<'a> {
    pub(crate) config: &'a Config,
    pub(crate) anchor: &'a Anchor,
    pub(crate) barrier: &'a mut Barrier,
    pub(crate) scratch: &'a mut Scratch,
}

impl Chooser<'_> {
    /// The first candidate that is proved: all joints as they wish, changed where a pair is near; at a smaller step;
    /// then each arm alone; then the plan.
    pub(crate) fn choose(&mut self, before: &Planned, on_plan: &Planned, aims: &Aims, scale: f64) -> Choice {
        let mut wishes = wishes(self.config, before, aims, scale);
        let mut choice = Choice::plan(*on_plan);
        let plan = Motion::stops(before);
        if self.config.certificate {
            choice.program = self.barrier.apply(self.config, self.anchor, &plan, &mut wishes);
            if choice.program == Program::Infeasible {
                return choice;
            }
        }
        let mut first = None;
        for step in STEPS {
            let attempt = Attempt::new(&wishes, &plan, on_plan, ALL_JOINTS, step);
            let Some(pair) = self.blamed(&mut choice, &attempt) else {
                return choice.taken(&attempt, Candidate::All);
            };
            first = Some(pair);
        }
        for (candidate, group) in [(Candidate::Left, LEFT), (Candidate::Right, RIGHT)] {
            // A pair that failed and that only this group moves would fail again.
            if first.is_some_and(|pair| self.config.geometry.pairs[pair].between & !group == 0) {
                continue;
            }
            let attempt = Attempt::new(&wishes, &plan, on_plan, group, 1.0);
            if attempt.fresh != 0 && self.blamed(&mut choice, &attempt).is_none() {
                return choice.taken(&attempt, candidate);
            }
        }
        choice
    }

    /// The pair for which an attempt could not be proved, if any.
    fn blamed(&mut self, choice: &mut Choice, attempt: &Attempt) -> Option<usize> {
        if !self.config.certificate {
            return None;
        }
        let Attempt { motion, fresh, .. } = attempt;
        let verdict = certify(&self.config.geometry, motion, Purpose::Decision, *fresh, self.anchor, self.scratch);
        choice.evaluations += verdict.evaluations;
        choice.fallbacks += u32::from(verdict.blamed.is_some());
        choice.refused = choice.refused.or(verdict.blamed);
        verdict.blamed
    }
}

/// The jerk at share `step` of the way from the plan's mean jerk over the tick to the wished one.
fn stepped(wish: &Wish, plan_a: f64, step: f64) -> Option<f64> {
    if step == 1.0 {
        return Some(wish.jerk);
    }
    let plan = (plan_a - wish.x.a) / TICK_S;
    wish.bounds.nearest_admissible(wish.x, plan + step * (wish.jerk - plan))
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
