//! The port: what a robot must offer to be driven.

use messages::{JOINTS, Stamp};

/// What the robot measures.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Measured {
    /// When it was measured.
    pub stamp: Stamp,
    /// Joint positions, rad or m.
    pub q: [f64; JOINTS],
    /// Joint velocities, rad/s or m/s.
    pub dq: [f64; JOINTS],
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

    /// Hands `setpoint` to the robot; `false` if the robot did not take it, which the caller passes on as
    /// `Input::port_fault` of the next tick.
    fn write(&mut self, now: Stamp, setpoint: &Setpoint) -> bool;
}
