//! Drives a robot that speaks ROS 2 (Humble), without an installation of ROS: trajectories over DDS, one for each
//! trajectory controller.
//!
//! - [`trajectory`]: the points of a message. The robot plays the certified stop from them when messages end.
//! - [`clock`]: the robot's clock, from its stamps.
//! - [`estimate`]: where the robot is now, from samples that are old. [`lag`]: by how much its servos lag.
//! - [`ros`], [`link`]: the messages of ROS 2 and the connection, in a thread of its own.
//! - `wire`: how messages pass a network that loses packets.
//! - [`preflight`], [`description`]: the checks before a robot may be driven.
//! - [`join`]: whether the robot executes what it is sent. If not, nothing is sent.
//! - [`port`]: the port of `crates/driver`, wait-free.

#![allow(clippy::neg_cmp_op_on_partial_ord, reason = "NaN differs from everything")]
#![allow(clippy::needless_range_loop, reason = "a joint index runs over several arrays at once")]

pub mod cli;
pub mod clock;
mod dds;
pub mod description;
mod emergency;
pub mod estimate;
pub mod join;
pub mod lag;
pub mod link;
pub mod port;
pub mod preflight;
pub mod ros;
pub mod trajectory;
mod wire;
