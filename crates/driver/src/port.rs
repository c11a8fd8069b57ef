//! The port: what a robot must offer to be driven.

use messages::{JOINTS, Stamp, StopPlan};

/// What the robot measures.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Measured {
    /// When it was measured.
    pub stamp: Stamp,
    /// Joint positions, rad or m.
    pub q: [f64; JOINTS],
    /// Joint velocities, rad/s or m/s.
    pub dq: [f64; JOINTS],
    /// What the drives say of themselves.
    pub drives: Drives,
    /// The robot had not answered the last setpoint yet when it measured this.
    pub unanswered: bool,
    /// The robot refused the last setpoint that it answered.
    pub refused: bool,
}

impl Measured {
    /// Time between the measurement and `now`, whichever is later, ns: a stamp of the future says nothing of now either.
    pub fn apart_ns(&self, now: Stamp) -> u64 {
        now.since(self.stamp).max(self.stamp.since(now))
    }
}

/// What a robot says of its drives.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Drives {
    /// The robot's own emergency stop is pressed. It is only observed: nothing here presses or releases it.
    pub emergency_stop: bool,
    /// A drive, of whichever joint, reports a fault.
    pub fault: bool,
    /// The motors have power.
    pub powered: bool,
}

impl Drives {
    /// Powered, and nothing to complain of.
    pub const SOUND: Self = Self { emergency_stop: false, fault: false, powered: true };

    /// Whether the robot can follow setpoints.
    pub const fn are_sound(self) -> bool {
        self.powered && !self.fault && !self.emergency_stop
    }
}

/// What the robot is to do at index `k`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Setpoint {
    /// Index; the time between two setpoints is `(k - k') T`, whenever they are written.
    pub k: u64,
    /// Joint positions, rad or m.
    pub q: [f64; JOINTS],
    /// Joint velocities, rad/s or m/s.
    pub v: [f64; JOINTS],
    /// Joint accelerations, rad/s^2 or m/s^2.
    pub a: [f64; JOINTS],
}

/// A robot. Both calls return at once; neither may block a tick.
pub trait Driver {
    /// The newest measurement at `now`; its stamp says how old it is.
    fn read(&mut self, now: Stamp) -> Measured;

    /// Hands `setpoint` to the robot, and the stop from there for a robot that plays it by itself; `false` if the robot did not take it, which the caller passes on as
    /// `Input::port_fault` of the next tick.
    ///
    /// A robot that was without power, or stopped by its own emergency stop, follows again only what begins where it
    /// stands: the follower sees to that, by holding what is measured as long as the drives are not sound.
    fn write(&mut self, now: Stamp, setpoint: &Setpoint, plan: &StopPlan) -> bool;
}
