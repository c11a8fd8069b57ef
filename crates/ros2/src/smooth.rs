//! Keeps steps away from the robot.
//!
//! After a fault the driver may hold the measured posture from one tick to the next, because a robot without power has
//! sunk. A robot that still has power would make that step. So a setpoint that does not continue the last one is not
//! sent. The robot gets the certified stop of the last one, then a slow approach to the posture that is held now.

use crate::trajectory::Executed;
use driver::Motion;
use messages::{JOINTS_MAX, TICK_S};

/// Speed of the approach, rad/s and m/s. Over one 10 ms point such a change of speed is 5 rad/s^2, less than an arm's
/// limit. It is half of a recovery's speed.
const APPROACH: f64 = 0.05;
/// Rounding of a position, rad or m.
const ROUNDING: f64 = 1e-6;

/// The motion that the robot was sent last.
#[derive(Clone, Debug)]
pub struct Smooth {
    sent: Option<(u64, Motion)>,
    approaches: bool,
    /// Largest acceleration of each joint, rad/s^2 or m/s^2.
    a_max: [f64; JOINTS_MAX],
}

impl Smooth {
    /// Creates the state before the first setpoint.
    pub fn new(a_max: [f64; JOINTS_MAX]) -> Self {
        Self { sent: None, approaches: false, a_max }
    }

    /// The motion to send at index `k` for the driver's `wanted`. A robot that is not `powered` gets what is wanted.
    pub fn pass(&mut self, k: u64, wanted: &Motion, powered: bool) -> Motion {
        let motion = match self.sent {
            Some((last_k, last)) if powered && k > last_k => {
                let ticks = k - last_k;
                self.approaches |= !self.continues(ticks, &last, wanted);
                if self.approaches { self.approach(ticks, last, wanted) } else { *wanted }
            }
            _ => {
                self.approaches = false;
                *wanted
            }
        };
        self.sent = Some((k, motion));
        motion
    }

    /// True while the robot is brought to the posture that the driver holds.
    pub fn approaches(&self) -> bool {
        self.approaches
    }

    fn continues(&self, ticks: u64, last: &Motion, wanted: &Motion) -> bool {
        let dt_s = ticks as f64 * TICK_S;
        (0..JOINTS_MAX).all(|j| {
            let changed = self.a_max[j] * dt_s;
            let off = wanted.q[j] - (last.q[j] + dt_s * last.v[j]);
            (wanted.v[j] - last.v[j]).abs() <= changed + ROUNDING && off.abs() <= changed * dt_s + ROUNDING
        })
    }

    fn approach(&mut self, ticks: u64, mut last: Motion, wanted: &Motion) -> Motion {
        last.play(ticks);
        if !last.at_rest() {
            return last;
        }
        let most = APPROACH * ticks as f64 * TICK_S;
        let q = std::array::from_fn(|j| last.q[j] + (wanted.q[j] - last.q[j]).clamp(-most, most));
        self.approaches = !(wanted.at_rest() && q == wanted.q);
        Motion::rest(q)
    }
}

/// The state of a motion at an index.
pub fn executed(k: u64, motion: &Motion) -> Executed {
    Executed { k, q: motion.q, v: motion.v }
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
        for k in 100..700 {
            let t = k as f64 * TICK_S;
            let wanted = moving(0.2 * (2.0 * t).sin(), 0.4 * (2.0 * t).cos());
            assert_eq!(smooth.pass(k, &wanted, true), wanted);
            assert!(!smooth.approaches());
        }
    }

    #[test]
    fn f117_step_becomes_a_stop_and_a_slow_approach() {
        for (speed, step) in [(0.0, 0.01), (0.0, -0.2), (1.0, 0.05), (-1.5, 0.0)] {
            let mut smooth = Smooth::new([A; JOINTS_MAX]);
            smooth.pass(10, &moving(0.3, speed), true);
            let held = Motion::rest([0.3 + step; JOINTS_MAX]);
            let (mut last, mut speeds) = ([0.3; 2], vec![speed]);
            for k in 11..20_000 {
                let sent = smooth.pass(k, &held, true);
                speeds.push((sent.q[0] - last[0]) / TICK_S);
                last = [sent.q[0], last[0]];
            }
            assert!(!smooth.approaches() && last[0] == 0.3 + step, "{speed}, {step}: ends at {}", last[0]);
            for pair in speeds.windows(2) {
                assert!((pair[1] - pair[0]).abs() <= APPROACH + A * TICK_S + 1e-9, "{speed}, {step}: {pair:?}");
            }
        }
    }

    #[test]
    fn robot_without_power_gets_the_measured_posture_at_once() {
        let mut smooth = Smooth::new([A; JOINTS_MAX]);
        smooth.pass(10, &Motion::rest([0.3; JOINTS_MAX]), true);
        let sunk = Motion::rest([0.5; JOINTS_MAX]);
        assert_eq!(smooth.pass(11, &sunk, false), sunk);
        assert_eq!(smooth.pass(12, &sunk, true), sunk, "and stays there when power returns");
    }
}
