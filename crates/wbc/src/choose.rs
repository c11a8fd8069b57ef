//! The decision of one tick: the wanted and the admissible motion of each joint, and the first candidate that
//! is proved.

use crate::barrier::{Barrier, JerkRange, Program};
use crate::brake::Bearing;
use crate::certificate::{Purpose, Scratch, certify};
use crate::chain::{JointSet, joints};
use crate::clearance::Anchor;
use crate::config::Config;
use crate::dynamics::PerJoint;
use crate::interval::Bounds;
use crate::plan::{JointState, JointStop, PlannedMotion};
use crate::tick::{Candidate, Input};
use crate::torque::{self, Load, TorqueScratch};
use crate::track::{JointAim, wanted_jerk, wanted_velocity};
use crate::trajectory::{JointTrajectory, Trajectory};
use messages::{JOINTS_MAX, JointMotion, TICK_S};

/// Shares of the way from the plan's jerk to the wanted one that are tried. The share 0 is the plan itself,
/// which needs no proof.
const STEPS: [f64; 2] = [1.0, 0.4];

/// Slack by which a speed may exceed the scale's. It is for rounding, and a tick adds 1e-15.
const SCALE_ROUNDING: f64 = 1e-9;

/// The aim of each joint. None means that the joint holds.
pub(crate) type Aims = [Option<JointAim>; JOINTS_MAX];

/// A certified decision.
pub(crate) struct Choice {
    pub(crate) next: JointMotion,
    pub(crate) candidate: Candidate,
    pub(crate) fresh: JointSet,
    pub(crate) program: Program,
    pub(crate) fallbacks: u32,
    /// The pair that could not be proved in the first wanted motion of this decision.
    pub(crate) refused: Option<usize>,
    /// The joint whose torque could not be proved, in the first motion refused for this reason, and the
    /// number of such motions.
    pub(crate) overloaded: Option<usize>,
    pub(crate) overloads: u32,
    pub(crate) evaluations: u32,
}

impl Choice {
    pub(crate) fn plan(next: JointMotion) -> Self {
        Self {
            next,
            candidate: Candidate::Plan,
            fresh: 0,
            program: Program::Idle,
            fallbacks: 0,
            refused: None,
            overloaded: None,
            overloads: 0,
            evaluations: 0,
        }
    }

    fn taken(self, attempt: &Attempt, candidate: Candidate) -> Self {
        // Without a new decision it is the plan, whatever the candidate was called.
        let candidate = if attempt.fresh == 0 { Candidate::Plan } else { candidate };
        Self { next: attempt.next, candidate, fresh: attempt.fresh, ..self }
    }
}

/// The aim of each joint in this tick, within its limits.
pub(crate) fn aims(config: &Config, input: &Input<'_>) -> Aims {
    let Some(target) = input.target else {
        return [None; JOINTS_MAX];
    };
    std::array::from_fn(|j| {
        if j >= config.count() {
            return None;
        }
        let meant = target.valid_mask & 1 << j != 0;
        let aim = if meant {
            JointAim { q: target.q[j], dq: target.dq[j], ddq: target.ddq[j] }
        } else {
            JointAim { q: config.home[j], dq: 0.0, ddq: 0.0 }
        };
        aim.within(&config.bounds[j])
    })
}

/// The wanted jerk of every joint at its share `scales` of its speed. None means that the joint plays its plan.
fn ranges(
    config: &Config,
    before: &JointMotion,
    aims: &Aims,
    scales: &PerJoint,
    brakes: &PerJoint,
) -> [Option<JerkRange>; JOINTS_MAX] {
    std::array::from_fn(|j| {
        let scale = scales[j];
        let (x, stop) = (before.joint(j), JointStop::from_plan(&before.plan, j));
        let nominal = Bounds { brake: brakes[j], ..config.bounds[j] };
        let bounds = relaxed(&nominal, config.hard_range[j], scale, x, &stop);
        // The requested speed is limited by the scale, not by the speed that the state makes unavoidable.
        let asked = Bounds { v_max: scale * config.bounds[j].v_max, ..config.bounds[j] };
        let fastest = x.v.abs().max(x.coasting_velocity(asked.j_max).abs());
        if fastest > asked.v_max * (1.0 + SCALE_ROUNDING) && x.v * x.a > 0.0 {
            // The joint is too fast for a scale that fell, and still gains speed. Nothing brakes sooner than the plan.
            return None;
        }
        let aim = aims[j]?;
        // Towards a far target, the joint is no faster than it can be stopped there.
        let approach = Bounds { a_max: brakes[j], ..asked };
        let Some(velocity) = wanted_velocity(x, aim, &approach) else {
            // The joint stays where it rests, unless it must make room.
            return (x.v == 0.0 && x.a == 0.0).then_some(JerkRange { x, bounds, wanted: 0.0, jerk: 0.0 });
        };
        let wanted = wanted_jerk(x, velocity, aim.ddq, &asked);
        let jerk = bounds.nearest_admissible(x, wanted)?;
        Some(JerkRange { x, bounds, wanted, jerk })
    })
}

/// One attempt: a group of joints takes new jerks, and the others play the plan.
struct Attempt {
    next: JointMotion,
    motion: Trajectory,
    fresh: JointSet,
}

impl Attempt {
    fn new(
        ranges: &[Option<JerkRange>; JOINTS_MAX],
        plan: &Trajectory,
        on_plan: &JointMotion,
        group: JointSet,
        step: f64,
    ) -> Self {
        let mut attempt = Self { next: *on_plan, motion: plan.clone(), fresh: 0 };
        for j in joints(group) {
            let Some(range) = &ranges[j] else { continue };
            let Some(jerk) = stepped(range, on_plan.a[j], step) else { continue };
            let (after, stop) = range.tick(jerk);
            attempt.next.set_joint(j, after, stop);
            attempt.motion.joints[j] = JointTrajectory::tick_then_stop(range.x, jerk, &stop);
            attempt.fresh |= 1 << j;
        }
        attempt
    }
}

/// The stages of a decision, with their working memory.
pub(crate) struct Chooser<'a> {
    pub(crate) config: &'a Config,
    /// Masses and motors, with the present payload of the hands.
    pub(crate) load: Option<&'a Load>,
    pub(crate) anchor: &'a mut Anchor,
    pub(crate) barrier: &'a mut Barrier,
    pub(crate) scratch: &'a mut Scratch,
    pub(crate) torque: &'a mut TorqueScratch,
}

impl Chooser<'_> {
    /// Returns the first candidate that is proved. The first is all joints as wanted, with changes where a
    /// pair is near. Then comes a smaller step, then each arm alone, and then the plan.
    pub(crate) fn choose(&mut self, before: &JointMotion, on_plan: &JointMotion, aims: &Aims, scale: f64) -> Choice {
        let plan = Trajectory::stops(before);
        self.torque.begin_tick();
        let load = self.load;
        let bearing = load.map(|load| {
            let ended =
                (!before.is_at_rest()).then(|| self.barrier.ended(&self.config.geometry, before.rest_posture()));
            Bearing::new(self.config, load, self.anchor, ended, before)
        });
        let nominal = || self.config.bounds.map(|bounds| bounds.brake);
        let brakes = bearing.as_ref().map_or_else(nominal, |bearing| bearing.brakes(self.config, before));
        let scales = self.scales(before, aims, bearing.as_ref(), scale);
        let mut ranges = ranges(self.config, before, aims, &scales, &brakes);
        let mut choice = Choice::plan(*on_plan);
        if self.config.certificate {
            choice.program = self.barrier.apply(self.config, self.anchor, &plan, &mut ranges);
            if choice.program == Program::Infeasible {
                return choice;
            }
        }
        for range in &mut ranges {
            *range = range.filter(|range| range.x.v != 0.0 || range.x.a != 0.0 || range.jerk != 0.0);
        }
        if let (Some(load), Some(bearing)) = (load, &bearing) {
            hold_back(self.config.geometry.chain.arms(), load, bearing, on_plan, &mut ranges);
        }
        let mut first = None;
        for step in STEPS {
            let attempt = Attempt::new(&ranges, &plan, on_plan, self.config.geometry.chain.all(), step);
            if self.too_fast(&mut choice, &attempt) {
                continue;
            }
            let Some(between) = self.blamed(&mut choice, &attempt) else {
                return choice.taken(&attempt, Candidate::All);
            };
            first = Some(between);
        }
        let [left, right] = self.config.geometry.chain.arms();
        for (candidate, group) in [(Candidate::Left, left), (Candidate::Right, right)] {
            // An attempt that failed and depends only on this group would fail again.
            if first.is_some_and(|between| between & !group == 0) {
                continue;
            }
            let attempt = Attempt::new(&ranges, &plan, on_plan, group, 1.0);
            if attempt.fresh != 0
                && !self.too_fast(&mut choice, &attempt)
                && self.blamed(&mut choice, &attempt).is_none()
            {
                return choice.taken(&attempt, candidate);
            }
        }
        choice
    }

    /// Each joint's share of its speed. It is the scale, or less if the bound on elbows and hands requires it.
    fn scales(&self, before: &JointMotion, aims: &Aims, bearing: Option<&Bearing>, scale: f64) -> PerJoint {
        let bounds = &self.config.bounds;
        let scales = bearing.map_or([1.0; JOINTS_MAX], |bearing| bearing.speeds(self.config)).map(|s| s.min(scale));
        let Some(hand) = &self.config.hand else { return scales };
        let wanted: PerJoint = std::array::from_fn(|j| {
            let asked = Bounds { v_max: scales[j] * bounds[j].v_max, ..bounds[j] };
            aims[j].and_then(|aim| wanted_velocity(before.joint(j), aim, &asked)).unwrap_or(0.0)
        });
        let shares = hand.shares(&self.config.geometry.chain, &self.anchor.placements, &wanted);
        std::array::from_fn(|j| match shares[j] {
            1.0 => scales[j],
            share => share * wanted[j].abs() / bounds[j].v_max,
        })
    }

    /// Returns true if an elbow or a hand would be too fast in an attempt.
    fn too_fast(&self, choice: &mut Choice, attempt: &Attempt) -> bool {
        let (chain, places) = (&self.config.geometry.chain, &self.anchor.placements);
        let too_fast = self.config.hand.as_ref().is_some_and(|hand| !hand.is_kept(chain, places, &attempt.motion));
        choice.fallbacks += u32::from(too_fast);
        too_fast
    }

    /// Returns the joints on which the failed proof of an attempt depends. None if everything is proved.
    fn blamed(&mut self, choice: &mut Choice, attempt: &Attempt) -> Option<JointSet> {
        let overloaded = self.overloaded(choice, attempt);
        if overloaded.is_some() || !self.config.certificate {
            return overloaded;
        }
        let Attempt { motion, fresh, .. } = attempt;
        let verdict = certify(&self.config.geometry, motion, Purpose::Decision, *fresh, self.anchor, self.scratch);
        choice.evaluations += verdict.evaluations;
        choice.fallbacks += u32::from(verdict.blamed.is_some());
        choice.refused = choice.refused.or(verdict.blamed);
        verdict.blamed.map(|pair| self.config.geometry.pairs[pair].between)
    }

    /// Returns the joints on which an unproved torque depends, if there is one.
    fn overloaded(&mut self, choice: &mut Choice, attempt: &Attempt) -> Option<JointSet> {
        let load = self.load?;
        let Attempt { motion, fresh, .. } = attempt;
        // A gentle brake may not make a stop longer than allowed.
        let late = joints(*fresh).find(|&j| motion.joints[j].end_s() > self.config.stop_time_max_s + TICK_S);
        let verdict = late.or_else(|| {
            let now = &self.anchor.turned;
            let verdict = torque::prove(load, &self.config.geometry.chain, (motion, now), *fresh, self.torque);
            choice.evaluations += verdict.evaluations;
            verdict.blamed
        });
        choice.fallbacks += u32::from(verdict.is_some());
        choice.overloads += u32::from(verdict.is_some());
        choice.overloaded = choice.overloaded.or(verdict);
        verdict.map(|j| load.related(j))
    }
}

/// Reduces the accelerations of each arm's wanted jerks to what its motors can give.
fn hold_back(
    arms: [JointSet; 2],
    load: &Load,
    bearing: &Bearing,
    on_plan: &JointMotion,
    ranges: &mut [Option<JerkRange>; JOINTS_MAX],
) {
    let mut wanted = on_plan.a;
    for j in 0..JOINTS_MAX {
        if let Some(range) = &ranges[j] {
            wanted[j] = range.x.a + range.jerk * TICK_S;
        }
    }
    for arm in arms {
        let share = bearing.step(load, arm, &on_plan.a, &wanted);
        if share >= 1.0 {
            continue;
        }
        for j in joints(arm) {
            if let Some(range) = &mut ranges[j] {
                range.jerk = stepped(range, on_plan.a[j], share).unwrap_or(range.jerk);
            }
        }
    }
}

/// The jerk at share `step` of the way from the plan's mean jerk over the tick to the wanted one.
fn stepped(range: &JerkRange, plan_a: f64, step: f64) -> Option<f64> {
    if step == 1.0 {
        return Some(range.jerk);
    }
    let plan = (plan_a - range.x.a) / TICK_S;
    range.bounds.nearest_admissible(range.x, plan + step * (range.jerk - plan))
}

/// The bounds of this tick. The plan may already go beyond the planned range or the scaled speed, at a limit
/// or after the scale fell. Then the bounds reach as far as the plan, but never beyond the limits themselves.
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
