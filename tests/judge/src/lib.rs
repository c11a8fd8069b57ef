//! Attacks the controllers of a robot, and judges what they command. For tests, `torture` and examples alone.
//!
//! The crate depends neither on `wbc` nor on `safety`, so it shares no arithmetic with what it judges. Distances
//! of capsules are parry's, those of obstacles are the simulated body's, and so are torques.

#![allow(clippy::needless_range_loop, reason = "a joint index runs over several arrays at once")]

mod attack;
mod commands;
pub mod joint;
pub mod limits;
mod nearest;
mod robot;
mod rollout;

pub use attack::{Attack, Attacker};
pub use commands::Checker;
pub use robot::{Robot, Tree, TreeJoint, surroundings};
pub use rollout::{Rolled, Rollout, roll};
