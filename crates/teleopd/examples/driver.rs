//! A complete driver for a made-up robot: position servos that approach their setpoints within some milliseconds.

use driver::{Driver, Drives, Interface, Measured, Setpoint};
use messages::{JOINTS_MAX, Stamp, StopPlan};
use std::process::ExitCode;

/// Time constant of a servo, s. Made up.
const SERVO_S: f64 = 0.005;

/// Setpoints stop for so long before the robot holds by itself, ns. Made up.
const WATCHDOG_NS: u64 = 20_000_000;

/// The connection to the robot. Yours owns a socket or a field bus, and a thread that waits for it.
struct Servos {
    limits: [robot::JointLimits; JOINTS_MAX],
    setpoint: [f64; JOINTS_MAX],
    written: Stamp,
    q: [f64; JOINTS_MAX],
    dq: [f64; JOINTS_MAX],
    measured: Stamp,
}

impl Servos {
    /// Connects. This robot stands in its home posture.
    fn open(model: &robot::Model) -> Result<Self, String> {
        let (q, now) = (model.home, rt::now());
        Ok(Self { limits: model.limits, setpoint: q, written: now, q, dq: [0.0; JOINTS_MAX], measured: now })
    }

    /// Moves the joints on to `now`. A real robot does that by itself.
    fn advance(&mut self, now: Stamp) {
        let dt_s = now.since(self.measured) as f64 * 1e-9;
        if now.since(self.written) > WATCHDOG_NS {
            self.setpoint = self.q;
        }
        for j in 0..JOINTS_MAX {
            let before = self.q[j];
            self.q[j] += (self.setpoint[j] - before) * (1.0 - (-dt_s / SERVO_S).exp());
            if dt_s > 0.0 {
                self.dq[j] = (self.q[j] - before) / dt_s;
            }
        }
        self.measured = now;
    }
}

impl Driver for Servos {
    /// Returns at once. `stamp` is the time at which the robot measured, by the clock of `rt::now`.
    fn read(&mut self, now: Stamp) -> Measured {
        self.advance(now);
        Measured {
            stamp: self.measured,
            q: self.q,
            dq: self.dq,
            drives: Drives { emergency_stop: false, fault: false, powered: true },
            unanswered: false,
            refused: false,
        }
    }

    /// Returns at once. `plan` is the stop from this setpoint, for a robot that can play it when setpoints end.
    fn write(&mut self, now: Stamp, setpoint: &Setpoint, _plan: &StopPlan) -> bool {
        let inside = |j: usize| (self.limits[j].q_min..=self.limits[j].q_max).contains(&setpoint.q[j]);
        if !(0..JOINTS_MAX).all(inside) {
            return false;
        }
        self.advance(now);
        (self.setpoint, self.written) = (setpoint.q, now);
        true
    }
}

fn main() -> ExitCode {
    // The servos take every setpoint. A controller that lays a spline through points of 100 Hz is `Jtc100`.
    teleopd::drive(Interface::Direct, Servos::open)
}
