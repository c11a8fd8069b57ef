//! A simulated robot behind the driver's port. Never does IO, never reads a clock, never allocates in a tick. The
//! same seed and the same inputs give the same run.
//!
//! Its parts share no arithmetic:
//!
//! - The driver's follower executes commands, and the [`interface`] hands them to the robot.
//! - The [`Body`] moves in wall time, with motors, friction and a watchdog of its own (crate `plant`). Its judge
//!   compares
//!   the joints' true motion with the limits.
//! - The checker compares every executed step with the limits of the URDF and of the robot file, and with the clearance
//!   of every checked pair. It shares no formula with `wbc`, `safety` or `driver`.
//!
//! Checker and judge only count. They never correct.

#![forbid(clippy::disallowed_macros, clippy::disallowed_methods, clippy::disallowed_types)]

mod body;
mod checker;
mod clearance;
mod config;
mod cubic;
mod gripper;
pub mod interface;
mod report;
mod robot;

pub use body::{Body, Port};
pub use checker::{Checker, TOLERANCE_A, TOLERANCE_CLEARANCE_M, TOLERANCE_J, TOLERANCE_Q, TOLERANCE_V};
pub use config::{
    Config, DELAY_MAX_TICKS, ENCODER_NOISE_MAX_RAD, OBJECT_MAX_M, Options, SimError, grippers, watchdog_max_ms,
};
pub use interface::Interface;
pub use plant::{Injection, Reaction};
pub use report::{Report, Violation, ViolationKind};
pub use robot::{DriverState, Input, Output, State, drive, tick};
