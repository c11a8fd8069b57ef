//! The simulated grippers: fingers that follow their setpoint and stop at an object.

use messages::{GripperMotion, GripperState, Layout, Stamp};

/// Time constant of the fingers' servos, s. Assumption.
const SERVO_S: f64 = 0.03;
/// Closure beyond the object at which the motor gives its full force. Assumption: a stiff position loop.
const FULL_FORCE_AT: f64 = 0.1;

/// A gripper of the robot.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gripper {
    /// Opening of the open fingers, m.
    pub opening_m: f64,
    /// Largest force of the fingers, N.
    pub force_max_n: f64,
}

impl Gripper {
    /// Returns the closure at which the fingers touch an object of this width, m: 0 is open, 1 is closed.
    fn closure_at(&self, width_m: f64) -> f64 {
        (1.0 - width_m / self.opening_m).clamp(0.0, 1.0)
    }
}

#[derive(Clone, Debug)]
pub(crate) struct Grippers {
    closure: [f64; 2],
    setpoint: GripperMotion,
    moved: Stamp,
}

impl Grippers {
    pub(crate) fn new(now: Stamp) -> Self {
        Self { closure: [0.0; 2], setpoint: GripperMotion::ZERO, moved: now }
    }

    /// Takes a setpoint. NaN is ignored.
    pub(crate) fn receive(&mut self, setpoint: &GripperMotion) {
        if setpoint.closure.iter().all(|closure| closure.is_finite()) {
            self.setpoint = *setpoint;
        }
    }

    /// Moves the fingers on to `now`, and measures them. `object_m` is the width of what lies between them, m.
    pub(crate) fn measure(&mut self, robot: &[Option<Gripper>; 2], object_m: f64, now: Stamp) -> GripperState {
        let share = 1.0 - (-(now.since(self.moved) as f64 * 1e-9) / SERVO_S).exp();
        self.moved = now;
        let mut state = GripperState::ZERO;
        for (side, gripper) in robot.iter().enumerate() {
            let Some(gripper) = gripper else { continue };
            let (end, target) = (gripper.closure_at(object_m), self.setpoint.closure[side].clamp(0.0, 1.0));
            self.closure[side] += (target.min(end) - self.closure[side]) * share;
            (state.closure[side], state.setpoint[side]) = (self.closure[side], target);
            let squeeze = if object_m > 0.0 { (target - end).max(0.0) / FULL_FORCE_AT } else { 0.0 };
            state.force_n[side] = gripper.force_max_n * squeeze.min(1.0);
        }
        state
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const GRIPPER: Gripper = Gripper { opening_m: 0.09, force_max_n: 16.0 };

    fn settled(object_m: f64, closure: f64) -> GripperState {
        let mut grippers = Grippers::new(Stamp(0));
        grippers.receive(&GripperMotion { closure: [closure, closure], rate: [0.0; 2] });
        grippers.measure(&[Some(GRIPPER), None], object_m, Stamp(1_000_000_000))
    }

    #[test]
    fn fingers_stop_at_object_and_press_nothing_without_one() {
        let held = settled(0.045, 1.0);
        assert!((held.closure[0] - 0.5).abs() < 1e-6 && held.force_n == [16.0, 0.0], "{held:?}");
        let touched = settled(0.045, 0.55);
        assert!((touched.closure[0] - 0.5).abs() < 1e-6 && (touched.force_n[0] - 8.0).abs() < 1e-6, "{touched:?}");
        let closed = settled(0.0, 1.0);
        assert!((closed.closure[0] - 1.0).abs() < 1e-6 && closed.force_n == [0.0; 2], "{closed:?}");
        assert_eq!(closed.closure[1], 0.0); // A hand without a gripper.
    }
}
