//! The motion of all joints at one instant, as stages hand it on.

use crate::command::{JointCommand, RobotState, StopPlan};
use crate::joints::JOINTS_MAX;
use crate::layout::Layout;
use crate::port::RobotSetpoint;

/// The motion of all joints at one instant, and the stop that follows if no command does. It is no message: a message
/// carries its four parts as fields of its own.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct JointMotion {
    /// Joint positions, rad or m.
    pub q: [f64; JOINTS_MAX],
    /// Joint velocities, rad/s or m/s.
    pub v: [f64; JOINTS_MAX],
    /// Joint accelerations, rad/s^2 or m/s^2.
    pub a: [f64; JOINTS_MAX],
    /// The rest of the stop from (q, v, a).
    pub plan: StopPlan,
}

impl JointMotion {
    /// Creates a motion at rest at `q` (rad, m), with an empty plan.
    pub const fn rest(q: [f64; JOINTS_MAX]) -> Self {
        Self { q, v: [0.0; JOINTS_MAX], a: [0.0; JOINTS_MAX], plan: StopPlan::ZERO }
    }

    /// Returns true if every joint stands still and the plan is empty. The test is exact: the end of a plan sets
    /// exact zeros.
    pub fn is_at_rest(&self) -> bool {
        let still = |x: &[f64; JOINTS_MAX]| x.iter().all(|&x| x == 0.0);
        still(&self.v) && still(&self.a) && self.plan.duration_s.as_flattened().iter().all(|&d| d == 0.0)
    }
}

/// Gives a message the two functions between its fields and a motion.
macro_rules! carries_motion {
    ($($message:ident),+) => {$(
        impl $message {
            /// The motion that the message carries.
            pub const fn motion(&self) -> JointMotion {
                JointMotion { q: self.q, v: self.v, a: self.a, plan: self.plan }
            }

            /// Returns the message with this motion.
            #[must_use]
            pub const fn with_motion(self, motion: &JointMotion) -> Self {
                Self { q: motion.q, v: motion.v, a: motion.a, plan: motion.plan, ..self }
            }
        }
    )+};
}

carries_motion!(JointCommand, RobotState, RobotSetpoint);
