//! A state of motion and the stop plan from it, with arithmetic of the driver's own.
//! The robot's motion after `control` dies must not depend on the code of `control`.

use crate::limits::JointLimits;
use messages::{JOINTS_MAX, JointMotion, StopPlan, TICK_S};

/// The driver's playback of a motion and the rest of its plan.
pub trait PlanPlayback {
    /// Plays `ticks` ticks of the plan.
    /// Once at rest, further ticks change nothing, so the plan's duration bounds the work and not `ticks`.
    fn play(&mut self, ticks: u64);

    /// Returns position, velocity and acceleration of joint `j` after `time_s` seconds of the plan.
    fn ahead(&self, j: usize, time_s: f64) -> [f64; 3];
}

impl PlanPlayback for JointMotion {
    fn play(&mut self, ticks: u64) {
        for _ in 0..ticks {
            if self.is_at_rest() {
                return;
            }
            play_tick(self);
        }
    }

    fn ahead(&self, j: usize, time_s: f64) -> [f64; 3] {
        let phases = self.plan.jerk[j].into_iter().zip(self.plan.duration_s[j]);
        let (joint, _) =
            phases.fold(([self.q[j], self.v[j], self.a[j]], time_s), |(now, rest_s), (jerk, duration_s)| {
                let t = rest_s.min(duration_s);
                (after(now, jerk, t), rest_s - t)
            });
        joint
    }
}

/// Returns a motion at `q` with a stop within the limits from the speeds `v` (rad/s, m/s). It reduces a speed whose
/// stop would leave the position limits. A joint that already brakes at its acceleration in `a` (rad/s^2, m/s^2) goes
/// on braking. No certificate covers the stop. It is for a robot that moved on without its driver.
pub(crate) fn stopping(
    limits: &[JointLimits; JOINTS_MAX],
    q: [f64; JOINTS_MAX],
    v: &[f64; JOINTS_MAX],
    a: &[f64; JOINTS_MAX],
) -> JointMotion {
    let mut motion = JointMotion::rest(q);
    for (j, limits) in limits.iter().enumerate() {
        let braking = -a[j] * v[j].signum();
        let v = limits.speed_inside(q[j], v[j], braking);
        let (braking, jerk, duration_s) = limits.stop_from(v, braking);
        (motion.v[j], motion.a[j]) = (v, -braking.copysign(v));
        (motion.plan.jerk[j], motion.plan.duration_s[j]) = (jerk, duration_s);
    }
    motion
}

/// Plays one tick of the plan.
pub(crate) fn play_tick(motion: &mut JointMotion) {
    for j in 0..JOINTS_MAX {
        play_joint(motion, j, TICK_S);
    }
}

/// Advances joint `j` by `rest_s` seconds of its phases.
fn play_joint(motion: &mut JointMotion, j: usize, mut rest_s: f64) {
    let (mut q, mut v, mut a) = (motion.q[j], motion.v[j], motion.a[j]);
    for phase in 0..3 {
        let t = rest_s.min(motion.plan.duration_s[j][phase]);
        if t > 0.0 {
            [q, v, a] = after([q, v, a], motion.plan.jerk[j][phase], t);
            motion.plan.duration_s[j][phase] -= t;
            rest_s -= t;
        }
    }
    if motion.plan.duration_s[j] == [0.0; 3] {
        // The plan ends at rest by contract. The remainder is rounding, and it must not drift for hours.
        (v, a) = (0.0, 0.0);
        motion.plan.jerk[j] = [0.0; 3];
    }
    (motion.q[j], motion.v[j], motion.a[j]) = (q, v, a);
}

/// Returns the time until the last joint stands, s.
pub(crate) fn duration_s(plan: &StopPlan) -> f64 {
    plan.duration_s.iter().map(|phases| phases.iter().sum()).fold(0.0, f64::max)
}

/// Returns the same path at `share` times the speed: Q(share t) where the plan is Q(t).
pub(crate) fn slowed(motion: &JointMotion, share: f64) -> JointMotion {
    let mut slowed = *motion;
    slowed.v.iter_mut().for_each(|v| *v *= share);
    slowed.a.iter_mut().for_each(|a| *a *= share * share);
    slowed.plan.jerk.iter_mut().flatten().for_each(|jerk| *jerk *= share * share * share);
    slowed.plan.duration_s.iter_mut().flatten().for_each(|duration_s| *duration_s /= share);
    slowed
}

/// Returns the largest |v| or |a| left at the end of the plan, in SI units. It is zero but for rounding
/// if the plan is a stop.
pub(crate) fn residue_at_end(motion: &JointMotion) -> f64 {
    let mut worst = 0.0_f64;
    for j in 0..JOINTS_MAX {
        let [_, v, a] = motion.ahead(j, f64::INFINITY);
        // Unlike `max`, this does not lose a NaN.
        worst = if v.is_finite() && a.is_finite() { worst.max(v.abs()).max(a.abs()) } else { f64::INFINITY };
    }
    worst
}

/// Returns position, velocity and acceleration after `t` seconds of constant jerk J:
/// q + v t + a t^2 / 2 + J t^3 / 6, v + a t + J t^2 / 2, a + J t.
pub(crate) fn after([q, v, a]: [f64; 3], jerk: f64, t: f64) -> [f64; 3] {
    [q + t * (v + t * (a / 2.0 + t * jerk / 6.0)), v + t * (a + t * jerk / 2.0), a + t * jerk]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A stop from v = 1 rad/s, a = 0: 0.1 s of jerk -100, 0.1 s of +100 (a returns to 0, v to 0), q moves 0.1 rad.
    fn moving() -> JointMotion {
        let mut motion = JointMotion::rest([0.0; JOINTS_MAX]);
        motion.v[3] = 1.0;
        motion.plan.jerk[3] = [-100.0, 100.0, 0.0];
        motion.plan.duration_s[3] = [0.1, 0.1, 0.0];
        motion
    }

    #[test]
    fn plan_ends_at_rest_at_its_closed_form_end() {
        let mut motion = moving();
        assert!(residue_at_end(&motion) < 1e-12);
        motion.play(299);
        assert!(!motion.is_at_rest(), "0.2 s are 300 ticks");
        motion.play(2);
        assert!(motion.is_at_rest());
        assert!((motion.q[3] - 0.1).abs() < 1e-12, "{}", motion.q[3]);
        let end = motion;
        motion.play(u64::MAX);
        assert_eq!(motion, end);
    }

    #[test]
    fn plan_that_does_not_stop_has_a_residue_at_its_end() {
        let mut motion = moving();
        motion.plan.duration_s[3][1] = 0.09;
        assert!(residue_at_end(&motion) > 0.5);
    }
}
