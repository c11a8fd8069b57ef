//! The body of a simulated robot, as another vendor would build it. Never does IO, never reads a clock, and never
//! allocates after construction. The same seed and the same calls give the same run.
//!
//! This crate is the second, independent reader of the URDF and of the robot file. It shares no code with `robot`,
//! `safety` or `wbc`, so it can contradict them. From `driver` it has the port alone.
//!
//! The owner calls [`Plant::advance_judged`] with the time, [`Plant::receive_judged`] with each new setpoint, and
//! then [`Plant::measure`]. Each of them integrates until the time that it gets. [`Plant::measure`] has no judge,
//! so it comes last. [`Plant`] and [`Judge`] are plain values: a clone is an independent simulation.

#![forbid(clippy::disallowed_macros, clippy::disallowed_methods, clippy::disallowed_types)]

mod apart;
mod config;
mod description;
mod distance;
mod dynamics;
mod error;
mod gripper;
mod injection;
mod judge;
mod kinematics;
mod links;
mod motor;
mod noise;
mod plant;
mod pose;
mod report;
mod robot;
mod robot_file;
mod urdf;

pub use apart::Apart;
pub use config::{Config, DELAY_MAX_TICKS, ENCODER_NOISE_MAX_RAD, OBJECT_MAX_M, Obstacle, Options, Reaction};
pub use description::{Body, Capsule, Inertia, Joint, JointKind, Limits};
pub use distance::{segment_box, segment_plane, segment_segment};
pub use dynamics::{Drive, Dynamics, GRAVITY_M_PER_S2, Posture};
pub use error::PlantError;
pub use gripper::Gripper;
pub use injection::Injection;
pub use judge::{CLEARANCE_MARGIN_M, JITTER_ALLOWANCE_NS, JUDGE_STEPS, Judge, SPEED_OVERSHOOT};
pub use kinematics::Frames;
pub use links::Links;
pub use plant::{
    CATCH_UP_NS, Measured, NEAR_M, NEAR_M_PER_S, NEAR_RAD, NEAR_RAD_PER_S, Plant, STEP_NS, Setpoint, Truth,
};
pub use pose::Pose;
pub use report::{Report, Violation, ViolationKind};
pub use robot::{Port, Robot};
