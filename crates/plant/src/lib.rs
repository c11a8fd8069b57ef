//! The body of a simulated robot, as another vendor would build it. Never does IO, never reads a clock, and never
//! allocates after construction. The same seed and the same calls give the same run.
//!
//! This crate is the second, independent reader of the URDF and of the robot file. It shares no code with `robot`,
//! `safety` or `wbc`, so it can contradict them. From `driver` it has the port alone.
//!
//! # Words
//!
//! - **Step**: the plant integrates in fixed steps of its own, [`STEP_NS`]. It knows no tick of the driver.
//! - **Setpoint**: a target for the drives. It acts after the transport delay, and it stays in force until the
//!   next.
//! - **Extrapolation**: between two setpoints the drives continue the last one with its velocity and
//!   acceleration.
//! - **Reaction**: the drives' own behaviour when setpoints stay away for longer than the watchdog allows.
//! - **Truth**: the real state of the joints. **Measured**: the encoders' readings of it.
//! - **Judge**: compares the truth with the limits, in wall time. It only counts, it never corrects.
//!
//! # Use
//!
//! The owner calls [`Plant::advance_judged`] with the time, [`Plant::receive_judged`] with each new setpoint, and
//! then [`Plant::measure`]. Each of them integrates until the time that it gets. [`Plant::measure`] has no judge,
//! so it comes last. [`Plant`] and [`Judge`] are plain values: a clone is an independent simulation.
//!
//! ```
//! use messages::{JOINTS_MAX, Layout, Stamp, StopPlan};
//! use plant::{Config, Options, Plant, Setpoint};
//!
//! # let read = |kind| std::fs::read_to_string(format!("../../config/robots/tiago_dual.{kind}"));
//! # let (toml, urdf) = (read("toml")?, read("urdf")?);
//! let config = Config::from_text("robot.toml", &toml, "robot.urdf", &urdf, &Options::default())?;
//! let (start, zero) = (Stamp(1_000_000_000), [0.0; JOINTS_MAX]);
//! let mut plant = Plant::new(&config, start, &zero, 1);
//! plant.receive(&config, start, &Setpoint { k: 1, q: zero, v: zero, a: zero, plan: StopPlan::ZERO });
//! assert!(!plant.measure(&config, start.plus_ns(5_000_000)).reacting);
//! assert!(plant.measure(&config, start.plus_ns(50_000_000)).reacting); // The watchdog fired.
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

#![forbid(clippy::disallowed_macros, clippy::disallowed_methods, clippy::disallowed_types)]

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

pub use config::{Config, DELAY_MAX_TICKS, ENCODER_NOISE_MAX_RAD, OBJECT_MAX_M, Obstacle, Options, Reaction};
pub use description::{Body, Capsule, Inertia, Joint, JointKind, Limits};
pub use distance::{segment_box, segment_plane, segment_segment};
pub use dynamics::{Drive, Dynamics, GRAVITY_M_PER_S2, Posture};
pub use error::PlantError;
pub use gripper::Gripper;
pub use injection::Injection;
pub use judge::{
    CLEARANCE_MARGIN_M, JITTER_ALLOWANCE_NS, JUDGE_STEPS, Judge, SERVO_MARGIN_M, SERVO_MARGIN_RAD, SPEED_OVERSHOOT,
};
pub use kinematics::Frames;
pub use links::{Links, Payload};
pub use plant::{
    CATCH_UP_NS, Measured, NEAR_M, NEAR_M_PER_S, NEAR_RAD, NEAR_RAD_PER_S, Plant, STEP_NS, Setpoint, Truth,
};
pub use pose::Pose;
pub use report::{Report, Violation, ViolationKind};
pub use robot::{Port, Robot};
