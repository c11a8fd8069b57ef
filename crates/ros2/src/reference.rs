//! Judges whether the robot executes what it is sent.
//!
//! Its controllers publish their own setpoints, the *reference*. A robot that missed messages, was restarted or stopped
//! by itself shows another reference than it was sent. The next message would then be a step. So nothing is sent to a
//! robot that departed. It plays its certified stop. The driver joins it again where its reference stands.

use crate::trajectory::Command;
use messages::{JOINTS_MAX, JointMotion, Stamp, TICK_S};

/// Largest difference between a reference and what was sent, rad or m, and per speed, s: the error of the robot's clock
/// and the phase of its updates. Assumption.
const OFF: f64 = 2e-3;
const OFF_S: f64 = 4e-3;
/// A reference that changes by less than this stands, rad or m.
const STANDS: f64 = 1e-4;
/// Time for which a reference must stand before the driver joins it, ns.
pub(crate) const STANDS_NS: u64 = 200_000_000;
/// Distance from a standing reference at which the driver may join, rad or m. A controller at 100 Hz makes 5 rad/s^2 of it.
pub(crate) const MEETS: f64 = 5e-4;
/// Largest difference between a controller's setpoint and the joint that it holds, rad or m. It is the tracking error that
/// `safety` tolerates.
pub const HELD: f64 = 0.05;
/// Largest acceleration of the cubic between two points that continue each other, as a share of the limit. The jerk of a
/// command alone gives 1.1.
const CONTINUES: f64 = 1.5;
/// Rounding of a position, rad or m.
const ROUNDING: f64 = 1e-9;

/// State of the conversation with the robot.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Joined {
    /// Nothing was sent yet.
    #[default]
    No,
    /// The robot executes what it is sent, since this time.
    Since(Stamp),
    Departed,
}

/// The robot's own setpoints.
#[derive(Clone, Copy, Debug)]
pub struct Reference {
    /// Positions, rad or m.
    pub q: [f64; JOINTS_MAX],
    /// Bit j: joint j was heard.
    known: u32,
    /// Time of the last change, by the robot's own stamps.
    changed: Stamp,
    /// Time of the newest setpoint of each joint, by the robot's own stamps.
    newest: [Stamp; JOINTS_MAX],
}

impl Default for Reference {
    fn default() -> Self {
        Self { q: [0.0; JOINTS_MAX], known: 0, changed: Stamp::NONE, newest: [Stamp::NONE; JOINTS_MAX] }
    }
}

impl Reference {
    /// Takes the reference of joint `j` that the robot had at `at`, by this machine's clock. An older one than the newest says
    /// nothing.
    pub fn receive(&mut self, j: usize, q: f64, at: Stamp) {
        if at < self.newest[j] {
            return;
        }
        // A NaN moves, and so does what comes after it.
        let stands = (q - self.q[j]).abs() <= STANDS;
        if self.known & 1 << j == 0 || !stands {
            (self.q[j], self.changed) = (q, self.changed.max(at));
        }
        self.newest[j] = at;
        self.known |= 1 << j;
    }

    /// True if setpoints of all `joints` show that they stood for long enough after `since`. A silent robot shows nothing.
    pub fn stands(&self, joints: u32, since: Stamp) -> bool {
        let from = self.changed.max(since);
        let shown = |j: usize| self.newest[j].since(from) >= STANDS_NS;
        self.known & joints == joints && (0..JOINTS_MAX).filter(|j| joints & 1 << j != 0).all(shown)
    }

    /// True if every joint of `all` stands where the driver wants to begin.
    pub fn meets(&self, wanted: &JointMotion, count: usize) -> bool {
        wanted.is_at_rest() && (0..count).all(|j| (wanted.q[j] - self.q[j]).abs() <= MEETS)
    }
}

/// True if a reference of joint `j` agrees with what was sent: position and velocity then.
pub fn agrees(reference: f64, sent: f64, velocity: f64) -> bool {
    (reference - sent).abs() <= OFF + OFF_S * velocity.abs()
}

/// True if `wanted` continues `from`. A controller puts a cubic between two points. With the change dv of the velocity in
/// the time h, and the distance e from the mean of both velocities, its acceleration is at most |dv| / h + 6 |e| / h^2.
pub fn continues(a_max: &[f64; JOINTS_MAX], from: &Command, wanted: &Command) -> bool {
    if wanted.k <= from.k {
        return false;
    }
    let h = (wanted.k - from.k) as f64 * TICK_S;
    let (from, to) = (&from.motion, &wanted.motion);
    (0..JOINTS_MAX).all(|j| {
        let off = to.q[j] - from.q[j] - h * (from.v[j] + to.v[j]) / 2.0;
        let cubic = (to.v[j] - from.v[j]).abs() * h + 6.0 * off.abs();
        cubic <= CONTINUES * a_max[j] * h * h + ROUNDING
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use messages::{Layout, StopPlan};
    use wbc::JointStop;

    const A: f64 = 8.0;
    const MS: u64 = 1_000_000;

    fn moving(q: f64, v: f64) -> JointMotion {
        let mut motion = JointMotion::rest([q; JOINTS_MAX]);
        let mut plan = StopPlan::ZERO;
        for j in 0..JOINTS_MAX {
            motion.v[j] = v;
            JointStop::new(v, 0.0, A, 320.0).store(&mut plan, j);
        }
        motion.plan = plan;
        motion
    }

    #[test]
    fn f117_only_what_continues_is_sent() {
        let a_max = [A; JOINTS_MAX];
        let at = |k: u64| {
            let t = k as f64 * TICK_S;
            Command { k, motion: moving(0.2 * (2.0 * t).sin(), 0.4 * (2.0 * t).cos()) }
        };
        assert!((100..700).all(|k| continues(&a_max, &at(k - 8), &at(k))));
        for (speed, step) in [(0.0, 0.01), (0.0, -0.2), (1.0, 0.05), (-1.5, 0.0)] {
            let held = Command { k: 18, motion: JointMotion::rest([0.3 + step; JOINTS_MAX]) };
            assert!(!continues(&a_max, &Command { k: 10, motion: moving(0.3, speed) }, &held), "{speed}, {step}");
        }
        assert!(!continues(&a_max, &at(9), &at(9)) && !continues(&a_max, &at(10), &at(9)), "an index only grows");
    }

    #[test]
    fn driver_joins_only_a_reference_that_stands_where_it_begins() {
        let mut reference = Reference::default();
        let at = |ms: u64| Stamp(1_000 * MS + ms * MS);
        let rest = JointMotion::rest([0.3; JOINTS_MAX]);
        assert!(!reference.stands(0b11, Stamp::NONE), "unknown");
        for ms in (0..300).step_by(20) {
            reference.receive(0, 0.3, at(ms));
            reference.receive(1, if ms < 100 { 0.2 } else { 0.3 + 1e-5 }, at(ms));
        }
        assert!(
            !reference.stands(0b11, Stamp::NONE),
            "it was seen to stand from 100 ms to 280 ms, whatever came later"
        );
        reference.receive(0, 0.3, at(300));
        assert!(!reference.stands(0b11, Stamp::NONE), "joint 1 is silent");
        reference.receive(1, 0.3, at(300));
        assert!(reference.stands(0b11, Stamp::NONE) && !reference.stands(0b111, Stamp::NONE));
        assert!(
            reference.stands(0b11, at(100)) && !reference.stands(0b11, at(101)),
            "before that it executed a message"
        );
        assert!(reference.meets(&rest, 2) && !reference.meets(&moving(0.3, 0.1), 2));
        assert!(!reference.meets(&JointMotion::rest([0.301; JOINTS_MAX]), 2));
        reference.receive(1, f64::NAN, at(302));
        reference.receive(0, 0.3, at(505));
        assert!(!reference.stands(0b11, Stamp::NONE) && !reference.meets(&rest, 2));
        // It does not stay.
        reference.receive(1, 0.3, at(304));
        reference.receive(1, 0.3, at(505));
        assert!(reference.stands(0b11, Stamp::NONE) && reference.meets(&rest, 2));
        // A setpoint of long ago comes late.
        reference.receive(1, 0.26, at(100));
        assert!(reference.stands(0b11, Stamp::NONE) && reference.meets(&rest, 2));
        // A joint that moved later counts for all.
        reference.receive(0, 0.29, at(600));
        reference.receive(1, 0.2, at(550));
        reference.receive(1, 0.2, at(780));
        assert!(!reference.stands(0b10, Stamp::NONE));
    }

    #[test]
    fn reference_of_a_robot_that_missed_messages_disagrees() {
        assert!(agrees(0.301, 0.3, 0.0) && agrees(0.305, 0.3, 1.0) && !agrees(0.303, 0.3, 0.0));
        assert!(!agrees(0.32, 0.3, 2.0) && !agrees(f64::NAN, 0.3, 0.0));
    }
}
