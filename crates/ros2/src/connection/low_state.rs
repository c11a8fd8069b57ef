//! States of a Unitree robot.

use super::Connection;
use crate::unitree::LowState;
use messages::{JOINTS_MAX, Stamp};

/// One tick of `rt/lowstate`, ns. It counts ms in Unitree's simulator (unitree_mujoco). Assumption for the robot.
const LOW_TICK_NS: i64 = 1_000_000;

impl Connection {
    pub(super) fn receive_low_state(&mut self, state: &LowState, now: Stamp) -> bool {
        let stamp_ns = i64::from(state.tick) * LOW_TICK_NS;
        // A tick that stands belongs to a state that stands.
        if self.latest.as_ref().is_some_and(|before| before.stamp_ns == stamp_ns) {
            return false;
        }
        let (mut q, mut dq) = ([0.0; JOINTS_MAX], [0.0; JOINTS_MAX]);
        for (j, motor) in self.motors.iter().enumerate() {
            let Some(motor) = state.motor_state.get(motor.index as usize) else { return false };
            (q[j], dq[j]) = (f64::from(motor.q), f64::from(motor.dq));
            if !q[j].is_finite() {
                self.incomplete = Some(format!("lowstate has {} for the position of `{}`", q[j], self.joint_names[j]));
                return false;
            }
        }
        if self.mode_machine.is_some_and(|known| known != state.mode_machine) {
            self.depart(format!("mode_machine became {}", state.mode_machine));
        }
        self.mode_machine = Some(state.mode_machine);
        self.receive_sample(stamp_ns, q, dq, now)
    }
}
