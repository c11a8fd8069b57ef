//! The port between the driver and a robot in a process of its own. Setpoints go one way and measurements the
//! other, as on a field bus.

use crate::command::{GripperMotion, GripperState, StopPlan};
use crate::joints::{JOINTS_MAX, RobotId};
use crate::layout::message;
use crate::time::{Header, Stamp};

/// Bits of `RobotMeasured::flags`.
pub mod measured_flag {
    /// The robot's own emergency stop is pressed.
    pub const EMERGENCY_STOP: u32 = 1;
    /// A drive reports a fault.
    pub const DRIVE_FAULT: u32 = 2;
    /// The motors have power.
    pub const POWERED: u32 = 4;
    /// The robot's watchdog fired, and the robot has not taken a setpoint since.
    pub const REACTING: u32 = 8;
    /// The robot did not take the newest setpoint.
    pub const REFUSED: u32 = 16;
}

message! {
    /// State that the drives should have at tick `k`.
    pub struct RobotSetpoint v 3 size 1824 {
        /// Its stamp is the time at which the driver sent it.
        pub header: Header,
        /// The robot whose joints these are.
        pub robot: RobotId,
        /// Tick index.
        pub k: u64,
        /// Joint positions, rad or m.
        pub q: [f64; JOINTS_MAX],
        /// Joint velocities, rad/s or m/s.
        pub v: [f64; JOINTS_MAX],
        /// Joint accelerations, rad/s^2 or m/s^2.
        pub a: [f64; JOINTS_MAX],
        /// The stop from (q, v, a), for a robot that plays it by itself.
        pub plan: StopPlan,
        /// The grippers.
        pub grippers: GripperMotion,
    }
}

message! {
    /// The robot's measurements.
    pub struct RobotMeasured v 3 size 704 {
        /// Its stamp is the time at which the robot sent it.
        pub header: Header,
        /// The robot whose joints these are.
        pub robot: RobotId,
        /// Time of the measurement.
        pub measured: Stamp,
        /// Tick index of the newest setpoint that the robot has received. Zero before the first.
        pub seen_k: u64,
        /// Joint positions, rad or m.
        pub q: [f64; JOINTS_MAX],
        /// Joint velocities, rad/s or m/s.
        pub dq: [f64; JOINTS_MAX],
        /// Motor torques or forces, N m or N.
        pub tau: [f64; JOINTS_MAX],
        /// Bits of `measured_flag`.
        pub flags: u32,
        /// Zero.
        pub reserved: u32,
        /// The grippers.
        pub grippers: GripperState,
    }
}
