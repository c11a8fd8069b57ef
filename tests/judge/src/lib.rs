//! Attacks the controllers of a robot, and judges what they command. For tests, `torture` and examples alone.
//!
//! The crate depends neither on `wbc` nor on `safety`, so it shares no arithmetic with what it judges. Distances
//! of capsules are parry's, those of obstacles are the simulated body's, and so are torques.
//!
//! - [`Robot`]: the poses of the bodies, the limits, and the clearance of a posture.
//! - [`Attacker`]: targets and permits that try to make the robot break a promise.
//! - [`joint`], [`limits`]: one joint's motion, and the limits that it breaks, in closed form.
//! - [`Checker`]: judges one command after the other.
//! - [`Rollout`], [`roll`]: a command's stop plan, played to rest.
//! - [`Meshes`]: what the capsules represent.

#![allow(clippy::needless_range_loop, reason = "a joint index runs over several arrays at once")]

mod attack;
mod commands;
pub mod joint;
pub mod limits;
mod meshes;
mod nearest;
mod robot;
mod rollout;

pub use attack::{Attack, Attacker};
pub use collision::dynamics;
pub use commands::Checker;
pub use meshes::Meshes;
pub use robot::{Robot, Tree, TreeJoint};
pub use rollout::{Rolled, Rollout, roll};
