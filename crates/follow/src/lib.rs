//! Predictive following: the motion of the arms that keeps the robot's limbs on the way of a person's, looking ahead.
//! Never performs IO, never reads a clock, and a tick never allocates, locks, blocks or panics.
//!
//! A joint-space law runs after every joint of a target posture. Near the shoulder's gimbal that posture spins while the
//! limb stands, and the robot is late and wrong. Here the limbs are followed: over a horizon of [`NODES`] nodes, 20 ms
//! apart, the accelerations are chosen that keep both limbs of an arm nearest to the person's, within speeds,
//! accelerations and ranges ([`solver`]). The person's way is known up to the newest skeleton and predicted beyond it.
//!
//! The wrist's joints turn no limb. Along the motion of the limbs they keep the hands away from the robot.
//!
//! Work is the same in every tick: an iteration of one arm is spread over [`ITERATION_TICKS`] ticks, the arms take turns,
//! and each begins from its last solution. What results is a wish. Whole-body control clips it, slides it along what is
//! near, and proves it, as it does with any other.
//!
//! Frames: limb rotations in the torso frame (x forward, y left, z up), as differences from the T-pose; a right arm is
//! mirrored to a left one. Units: rad, s.

#![allow(clippy::needless_range_loop, reason = "a joint index runs over several arrays at once")]

pub mod arm;
mod plan;
pub mod solver;
mod tick;
mod wrist;

pub use tick::{Aim, Config, Input, Output, State, Weights, tick};

/// Joints of an arm that turn its limbs: 1 to 5.
pub const LIMB_JOINTS: usize = 5;
/// Nodes of the horizon.
pub const NODES: usize = messages::WAY_NODES;
/// Ticks in which one arm's iteration is done.
pub const ITERATION_TICKS: u64 = 5;
