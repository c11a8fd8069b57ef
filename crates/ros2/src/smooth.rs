//! Keeps steps away from the robot.
//!
//! After a fault the driver may hold the measured posture from one tick to the next, because a robot without power has
//! sunk. A robot that still has power would make that step. A robot that messages reach too late has begun to stop, and
//! would be taken back with one. So a setpoint that does not continue what the robot executes is not sent. The robot gets
//! the rest of its certified stop, then a slow approach.
//!
//! A controller puts a cubic between two points. With the change dv of the velocity in the time h, and the distance e from
//! the mean of both velocities, its acceleration is at most
//!
//! ```text
//! |dv| / h + 6 |e| / h^2
//! ```

use crate::trajectory::Command;
use driver::Motion;
use messages::{JOINTS_MAX, TICK_S};

/// Speed of the approach, rad/s and m/s. Over one 10 ms update such a change of speed is 5 rad/s^2, less than an arm's
/// limit. It is half of a recovery's speed.
const APPROACH: f64 = 0.05;
/// Largest acceleration of the cubic between two points that continue each other, as a share of the limit. The jerk of a
/// command alone gives 1.1.
const CONTINUES: f64 = 1.5;
/// Rounding of a position, rad or m.
const ROUNDING: f64 = 1e-9;

/// Whether the robot is brought to the posture that the driver holds.
#[derive(Clone, Debug)]
pub struct Smooth {
    approaches: bool,
    /// Largest acceleration of each joint, rad/s^2 or m/s^2.
    a_max: [f64; JOINTS_MAX],
}

impl Smooth {
    /// Creates the state before the first setpoint.
    pub fn new(a_max: [f64; JOINTS_MAX]) -> Self {
        Self { approaches: false, a_max }
    }

    /// The command to send in place of `wanted`. The robot comes from `from`, with its stop. A robot that is not
    /// `powered` gets what is wanted, and so does one that was sent nothing.
    pub fn pass(&mut self, from: Option<&Command>, wanted: &Command, powered: bool) -> Command {
        let Some(from) = from.filter(|from| powered && wanted.k > from.k) else {
            self.approaches = false;
            return *wanted;
        };
        self.approaches |= !self.continues(from, wanted);
        let motion = if self.approaches { self.approach(from, wanted) } else { wanted.motion };
        Command { k: wanted.k, motion }
    }

    /// True while the robot is brought to the posture that the driver holds.
    pub fn approaches(&self) -> bool {
        self.approaches
    }

    fn continues(&self, from: &Command, wanted: &Command) -> bool {
        let h = (wanted.k - from.k) as f64 * TICK_S;
        let (from, to) = (&from.motion, &wanted.motion);
        (0..JOINTS_MAX).all(|j| {
            let off = to.q[j] - from.q[j] - h * (from.v[j] + to.v[j]) / 2.0;
            let cubic = (to.v[j] - from.v[j]).abs() * h + 6.0 * off.abs();
            cubic <= CONTINUES * self.a_max[j] * h * h + ROUNDING
        })
    }

    fn approach(&mut self, from: &Command, wanted: &Command) -> Motion {
        let (mut motion, ticks) = (from.motion, wanted.k - from.k);
        motion.play(ticks);
        if !motion.at_rest() {
            return motion;
        }
        let most = APPROACH * ticks as f64 * TICK_S;
        let goal = &wanted.motion;
        let q = std::array::from_fn(|j| motion.q[j] + (goal.q[j] - motion.q[j]).clamp(-most, most));
        self.approaches = !(goal.at_rest() && q == goal.q);
        Motion::rest(q)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use messages::{Layout, StopPlan};
    use wbc::JointStop;

    const A: f64 = 8.0;

    fn moving(q: f64, v: f64) -> Motion {
        let mut motion = Motion::rest([q; JOINTS_MAX]);
        let mut plan = StopPlan::ZERO;
        for j in 0..JOINTS_MAX {
            motion.v[j] = v;
            JointStop::new(v, 0.0, A, 320.0).store(&mut plan, j);
        }
        motion.plan = plan;
        motion
    }

    #[test]
    fn motion_that_continues_passes_unchanged() {
        let mut smooth = Smooth::new([A; JOINTS_MAX]);
        let at = |k: u64| {
            let t = k as f64 * TICK_S;
            Command { k, motion: moving(0.2 * (2.0 * t).sin(), 0.4 * (2.0 * t).cos()) }
        };
        for k in 100..700 {
            assert_eq!(smooth.pass(Some(&at(k - 8)), &at(k), true), at(k));
            assert!(!smooth.approaches());
        }
    }

    #[test]
    fn f117_step_becomes_a_stop_and_a_slow_approach() {
        for (speed, step) in [(0.0, 0.01), (0.0, -0.2), (1.0, 0.05), (-1.5, 0.0)] {
            let mut smooth = Smooth::new([A; JOINTS_MAX]);
            let mut last = Command { k: 10, motion: moving(0.3, speed) };
            let held = Motion::rest([0.3 + step; JOINTS_MAX]);
            let mut speeds = vec![speed];
            for k in 11..20_000 {
                let sent = smooth.pass(Some(&last), &Command { k, motion: held }, true);
                speeds.push((sent.motion.q[0] - last.motion.q[0]) / TICK_S);
                last = sent;
            }
            let end = last.motion.q[0];
            assert!(!smooth.approaches() && end == 0.3 + step, "{speed}, {step}: ends at {end}");
            for pair in speeds.windows(2) {
                assert!((pair[1] - pair[0]).abs() <= APPROACH + A * TICK_S + 1e-9, "{speed}, {step}: {pair:?}");
            }
        }
    }

    #[test]
    fn robot_without_power_gets_the_measured_posture_at_once() {
        let at = |k, q| Command { k, motion: Motion::rest([q; JOINTS_MAX]) };
        let mut smooth = Smooth::new([A; JOINTS_MAX]);
        assert_eq!(smooth.pass(Some(&at(10, 0.3)), &at(11, 0.5), false), at(11, 0.5));
        assert_eq!(smooth.pass(Some(&at(11, 0.5)), &at(12, 0.5), true), at(12, 0.5), "and stays when power returns");
    }
}
