//! The driver of any robot, with a checker of every executed step. Never does IO, never reads a clock, never allocates in a
//! tick. The same seed and the same inputs give the same run.
//!
//! Its parts share no arithmetic:
//!
//! - The driver's follower executes commands, and the simulated controllers of [`driver::Interface`] hand them to the robot.
//! - The checker compares every executed step with the limits of the URDF and of the robot file, and with the clearance
//!   of every checked pair. It shares no formula with `wbc`, `safety` or `driver`. The torques come from `plant`'s own
//!   reader of the robot's files. The checker only counts. It never corrects.

#![forbid(clippy::disallowed_macros, clippy::disallowed_methods, clippy::disallowed_types)]

mod checker;
mod clearance;
mod config;
mod controllers;
mod cubic;
mod report;
mod state;

pub use checker::{Checker, TOLERANCE_A, TOLERANCE_CLEARANCE_M, TOLERANCE_J, TOLERANCE_Q, TOLERANCE_V};
pub use config::{CheckerError, Config, Options, grippers, strictest};
pub use controllers::{spline_error, spline_speed_error};
pub use report::{Report, Violation, ViolationKind};
pub use state::{State, drive};
