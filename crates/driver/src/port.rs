//! The port: the interface that a robot must offer to be driven.

use messages::{GripperMotion, GripperState, JOINTS_MAX, Stamp, StopPlan};

/// Largest noise of a position, rad or m: eight standard deviations of an encoder of 17 bits.
pub(crate) const ENCODER_NOISE: f64 = 4e-4;
/// Noise of a measurement, rad or m. `safety` uses the same value.
pub(crate) const NOISE: f64 = 0.005;

/// A measurement of the robot.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Measured {
    /// Time of the measurement.
    pub stamp: Stamp,
    /// Joint positions, rad or m.
    pub q: [f64; JOINTS_MAX],
    /// Joint velocities, rad/s or m/s.
    pub dq: [f64; JOINTS_MAX],
    /// State that the drives report.
    pub drives: Drives,
    /// True if the robot had not answered the last setpoint yet when it measured this.
    pub unanswered: bool,
    /// True if the robot refused the last setpoint that it answered.
    pub refused: bool,
}

impl Measured {
    /// Returns the time between the measurement and `now`, ns, whichever is later.
    /// A stamp in the future says nothing about the present either.
    pub fn apart_ns(&self, now: Stamp) -> u64 {
        now.since(self.stamp).max(self.stamp.since(now))
    }
}

/// State that a robot reports of its drives.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Drives {
    /// The robot's own emergency stop is pressed. It is only observed: nothing here presses or releases it.
    pub emergency_stop: bool,
    /// The drive of any joint reports a fault.
    pub fault: bool,
    /// The motors have power.
    pub powered: bool,
}

impl Drives {
    /// Drives that are powered, without fault or emergency stop.
    pub const SOUND: Self = Self { emergency_stop: false, fault: false, powered: true };

    /// Returns true if the robot can follow setpoints.
    pub const fn are_sound(self) -> bool {
        self.powered && !self.fault && !self.emergency_stop
    }
}

/// The robot's target at index `k`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Setpoint {
    /// Index. The time between two setpoints is `(k - k') T`, no matter when they are written.
    pub k: u64,
    /// Joint positions, rad or m.
    pub q: [f64; JOINTS_MAX],
    /// Joint velocities, rad/s or m/s.
    pub v: [f64; JOINTS_MAX],
    /// Joint accelerations, rad/s^2 or m/s^2.
    pub a: [f64; JOINTS_MAX],
}

/// A robot. Both calls return at once. Neither may block a tick.
pub trait Driver {
    /// Returns the newest measurement at `now`. Its stamp says how old it is.
    fn read(&mut self, now: Stamp) -> Measured;

    /// Hands `setpoint` to the robot, and the stop from there for a robot that plays it by itself. Returns `false` if
    /// the robot did not take it. The caller passes that on as `Input::port_fault` of the next tick.
    ///
    /// A robot that was without power, or stopped by its own emergency stop, follows again only from where it stands.
    /// The follower ensures that: it holds the measured posture as long as the drives are not sound.
    fn write(&mut self, now: Stamp, setpoint: &Setpoint, plan: &StopPlan) -> bool;

    /// Takes the motion of the grippers. Called before each [`Driver::write`], which sends it. A robot without grippers
    /// ignores it.
    fn grip(&mut self, _grippers: &GripperMotion) {}

    /// Returns the grippers as last measured. `None` for a robot that does not measure them.
    fn gripped(&self) -> Option<GripperState> {
        None
    }
}
