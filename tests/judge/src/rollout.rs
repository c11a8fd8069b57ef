//! Plays a command's stop plan to rest and judges it at many instants. It uses closed-form polynomials per
//! phase, parry's segment distance, and the dynamics of the simulated robot. Neither whole-body control nor the
//! gate uses these formulas and distances.

use crate::joint::{Joint, Stop, duration_s, stop_of};
use crate::limits::{Slack, plan};
use crate::robot::Robot;
use checker::{TOLERANCE_CLEARANCE_M, TOLERANCE_J, TOLERANCE_Q, ViolationKind};
use messages::{JOINTS_MAX, JointMotion};

/// Time between two judged instants, s. In a millisecond no point of the robot moves more than a few
/// millimetres. The first instant is drawn at random for every plan.
const STEP_S: f64 = 1e-3;

/// Rounding of a torque over its limit. Accelerations have rounding errors of 1e-11 rad/s^2 at 2 kg m^2, and
/// limits are at least 2 N m.
const TOLERANCE_TORQUE: f64 = 1e-9;

/// Rounding of a plan. A plan that does not end at rest is a violation, even if its jerks are allowed.
const SLACK: Slack = Slack { state: TOLERANCE_Q, jerk: TOLERANCE_J, step: TOLERANCE_Q, rest: driver::REST_TOLERANCE };

/// A motion and its stop plan, at any time from now on.
#[derive(Clone, Debug)]
pub struct Rollout([(Joint, Stop); JOINTS_MAX]);

impl Rollout {
    /// Takes the motion of a command.
    pub fn new(motion: &JointMotion) -> Self {
        Self(std::array::from_fn(|j| (joint_of(motion, j), stop_of(&motion.plan, j))))
    }

    /// Time until the last joint is at rest, s.
    pub fn end_s(&self) -> f64 {
        self.0.iter().map(|(_, stop)| duration_s(stop)).fold(0.0, f64::max)
    }

    /// All joints after `t` seconds.
    pub fn at(&self, t: f64) -> [Joint; JOINTS_MAX] {
        self.0.map(|(joint, stop)| joint.play(&stop, t))
    }

    /// All joints now, after `first_s`, then every `step_s`, and at rest.
    pub fn instants(&self, first_s: f64, step_s: f64) -> impl Iterator<Item = [Joint; JOINTS_MAX]> + '_ {
        let end_s = self.end_s();
        let later = std::iter::successors(Some(first_s), move |t| Some(t + step_s)).take_while(move |t| *t < end_s);
        std::iter::once(0.0).chain(later).chain((end_s > 0.0).then_some(end_s)).map(|t| self.at(t))
    }

    /// The postures of [`instants`](Self::instants).
    pub fn postures(&self, step_s: f64) -> impl Iterator<Item = [f64; JOINTS_MAX]> + '_ {
        self.instants(step_s, step_s).map(|joints| joints.map(|joint| joint.q))
    }
}

/// Returns one joint of a motion.
pub(crate) fn joint_of(motion: &JointMotion, j: usize) -> Joint {
    Joint { q: motion.q[j], v: motion.v[j], a: motion.a[j] }
}

/// Result of a plan.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rolled {
    /// Number of joints or instants that violate, by kind. A joint counts once.
    pub violations: [u64; ViolationKind::ALL.len()],
    /// Least clearance, m: of the checked pairs, and to the obstacles.
    pub min_clearance_m: f64,
    /// Largest torque over its effort limit.
    pub torque_share: f64,
}

/// Judges the plan of `motion` from now to rest. The first instant after now is `offset` (0 to 1) of a step
/// later. The torques are those of `checker`, and no torque may exceed `share_max` of its effort limit.
pub fn roll(robot: &Robot, checker: &checker::Config, share_max: f64, motion: &JointMotion, offset: f64) -> Rolled {
    let rollout = Rollout::new(motion);
    let violations = [0; ViolationKind::ALL.len()];
    let mut rolled = Rolled { violations, min_clearance_m: f64::INFINITY, torque_share: 0.0 };
    for ((joint, stop), limits) in rollout.0.iter().zip(&robot.limits) {
        if let Some(breach) = plan(limits, *joint, stop, SLACK) {
            rolled.violations[breach.kind as usize] += 1;
        }
    }
    for joints in rollout.instants(offset * STEP_S, STEP_S) {
        let share = torque_share(robot, checker, &joints);
        rolled.torque_share = rolled.torque_share.max(share);
        let bearable = share <= share_max + TOLERANCE_TORQUE;
        rolled.violations[ViolationKind::Torque as usize] += u64::from(!bearable);
        let clearance_m = robot.clearance(&joints.map(|joint| joint.q));
        rolled.min_clearance_m = rolled.min_clearance_m.min(clearance_m);
        let clear = clearance_m >= robot.d_min_m - TOLERANCE_CLEARANCE_M;
        rolled.violations[ViolationKind::Clearance as usize] += u64::from(!clear);
    }
    rolled
}

/// Returns the largest torque over its effort limit.
fn torque_share(robot: &Robot, checker: &checker::Config, joints: &[Joint; JOINTS_MAX]) -> f64 {
    let torques = checker.torques(&joints.map(|x| x.q), &joints.map(|x| x.v), &joints.map(|x| x.a));
    let shares = torques.iter().zip(&robot.limits).map(|(torque, limits)| torque.abs() / limits.effort_max);
    shares.fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;
    use robot::Frames;

    const SHARE: f64 = 0.85;

    fn shipped() -> (Robot, checker::Config) {
        let robot = Robot::load(concat!(env!("CARGO_MANIFEST_DIR"), "/../../config/robots/tiago_dual.toml"));
        let checker = checker::Config::new(robot.model().unwrap(), &checker::Options::default()).unwrap();
        (robot, checker)
    }

    /// A stop of joint `j` from `v` with `jerk`, then `-jerk`. Each phase lasts sqrt(v / jerk).
    fn stop(robot: &Robot, j: usize, v: f64, jerk: f64) -> JointMotion {
        let mut motion = JointMotion::rest(robot.home);
        let t = (v / jerk).sqrt();
        motion.v[j] = v;
        motion.plan.jerk[j] = [-jerk, jerk, 0.0];
        motion.plan.duration_s[j] = [t, t, 0.0];
        motion
    }

    #[test]
    fn rollout_at_rest_has_no_violation_and_the_models_clearance() {
        let (robot, checker) = shipped();
        let rolled = roll(&robot, &checker, SHARE, &JointMotion::rest(robot.home), 0.5);
        let (model, mut frames) = (robot.model().unwrap(), Frames::default());
        model.forward(&robot.home, &mut frames);
        assert_eq!(rolled.violations, [0; ViolationKind::ALL.len()]);
        assert!((rolled.min_clearance_m - model.clearance(&frames).0).abs() < 1e-12);
    }

    #[test]
    fn rollout_reports_every_kind_of_bad_plan() {
        let (robot, checker) = shipped();
        let kinds = |motion: &JointMotion| roll(&robot, &checker, SHARE, motion, 0.3).violations.map(|n| n > 0);
        let limits = &robot.limits[4];
        // The peak of the acceleration is sqrt(v jerk). It is A if v is A^2 / jerk.
        let (gentle, full) = (0.9 * limits.j_max, limits.a_max * limits.a_max / limits.j_max);
        assert_eq!(kinds(&stop(&robot, 4, 0.5 * full, gentle)), [false; ViolationKind::ALL.len()]);
        assert!(kinds(&stop(&robot, 4, 0.5 * full, 1.1 * limits.j_max))[ViolationKind::Jerk as usize]);
        assert!(kinds(&stop(&robot, 4, 1.5 * full, gentle))[ViolationKind::Acceleration as usize]);
        assert!(kinds(&stop(&robot, 4, 1.1 * limits.v_max, gentle))[ViolationKind::Velocity as usize]);
        let mut short = stop(&robot, 4, 0.5 * full, gentle);
        short.plan.duration_s[4][1] *= 0.9;
        assert!(kinds(&short)[ViolationKind::Jerk as usize], "a plan that does not end at rest");
        let mut outside = stop(&robot, 4, 0.5 * full, gentle);
        outside.q[4] = limits.q_max;
        assert!(kinds(&outside)[ViolationKind::Position as usize]);
        // It leaves the limits and comes back within one phase, whose jerk is nearly or exactly zero.
        let (v, a) = (0.1, 0.7 * limits.a_max);
        let back = ((a * a + 2.0 * limits.j_max * v) / 2.0).sqrt();
        for jerk in [0.0, 1e-300, 1e-14] {
            let mut over = stop(&robot, 4, v, gentle);
            (over.q[4], over.a[4]) = (limits.q_max - 1e-4, -a);
            over.plan.jerk[4] = [jerk, limits.j_max, -limits.j_max];
            over.plan.duration_s[4] = [2.0 * v / a, (a + back) / limits.j_max, back / limits.j_max];
            assert!(kinds(&over)[ViolationKind::Position as usize], "jerk {jerk:e}");
        }
        let mut nowhere = JointMotion::rest(robot.home);
        nowhere.q[4] = f64::NAN;
        assert!(kinds(&nowhere)[ViolationKind::Position as usize]);
        // A stretched arm that falls at half its speed cannot brake at the full rate.
        let mut falling = stop(&robot, 4, 0.98, 0.0);
        falling.q[3..10].fill(0.0);
        let rise = limits.a_max / limits.j_max;
        falling.plan.jerk[4] = [-limits.j_max, 0.0, limits.j_max];
        falling.plan.duration_s[4] = [rise, 0.98 / limits.a_max - rise, rise];
        assert!(kinds(&falling)[ViolationKind::Torque as usize]);
        // Slow motion from home with the left arm across the body leads into a collision.
        let mut through = JointMotion::rest(robot.home);
        (through.v[3], through.plan.duration_s[3]) = (1.5, [3.0, 0.0, 0.0]);
        (through.v[10], through.plan.duration_s[10]) = (1.5, [3.0, 0.0, 0.0]);
        assert!(kinds(&through)[ViolationKind::Clearance as usize]);
    }
}
