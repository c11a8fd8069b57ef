//! Predictive following: the motion of the arms that keeps the robot's limbs on the person's limb trajectory.
//! Never performs IO, never reads a clock, and a tick never allocates, locks, blocks or panics.
//!
//! A joint-space law follows every joint of a target posture. Near the shoulder's gimbal that posture spins while
//! the limb stands still, and the robot is late and wrong. This crate follows the limbs. Its horizon has [`NODES`]
//! nodes, 20 ms apart. It chooses the accelerations that keep both limbs of an arm nearest to the person's, within
//! speeds, accelerations and ranges ([`solver`]). The person's motion is measured up to the newest skeleton and
//! predicted beyond it.
//!
//! The robot itself is in the horizon too. An arm keeps off the body and the other arm where the person's posture
//! would touch them ([`gap`]). The wrist's joints turn no limb, so they keep the hands away first.
//!
//! The work is the same in every tick. An iteration of one arm is spread over [`ITERATION_TICKS`] ticks. The arms
//! take turns, and each starts from its last solution. The result is a reference for whole-body control, which
//! clips it, slides it along nearby obstacles, and certifies it.
//!
//! Frames: limb rotations in the torso frame (x forward, y left, z up), as differences from the T-pose. A right
//! arm is mirrored to a left one. Units: rad, s.

#![forbid(clippy::disallowed_macros, clippy::disallowed_methods, clippy::disallowed_types)]
#![allow(clippy::needless_range_loop, reason = "a joint index runs over several arrays at once")]

pub mod arm;
pub mod gap;
mod plan;
mod proximity;
pub mod solver;
mod tick;
mod wrist;

pub use tick::{Aim, Config, Input, Output, State, Weights, tick};

/// Slots of the joints that turn the limbs of an arm: three for the upper arm, two for the forearm. An empty slot has no axis.
pub const LIMB_JOINTS: usize = 5;
/// Nodes of the horizon.
pub const NODES: usize = messages::TRAJECTORY_NODES;
/// Ticks that one arm's iteration takes.
pub const ITERATION_TICKS: u64 = 5;
