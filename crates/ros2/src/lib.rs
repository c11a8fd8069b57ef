//! Drives a robot that speaks DDS, without an installation of ROS: trajectory controllers of ROS 2 (Humble), controllers that
//! take positions, or the arms of a Unitree robot.
//!
//! - [`trajectory`]: the points of a message. The robot plays the certified stop from them when messages end.
//! - [`stream`]: positions for a robot that plays no stop. [`unitree`]: the messages of `rt/arm_sdk`.
//! - [`gravity`]: the torques in them. [`interface`]: which of the three it is.
//! - [`hands`]: the grippers.
//! - [`clock`]: the robot's clock, from its stamps.
//! - [`estimate`]: where the robot is now, from samples that are old. [`lag`]: by how much its servos lag.
//! - [`ros`], [`connection`]: the messages of ROS 2 and the connection, in a thread of its own.
//! - `wire`: how messages pass a network that loses packets.
//! - [`preflight`], [`description`]: the checks before a robot may be driven.
//! - [`mod@reference`], `curves`: whether trajectory controllers execute what they are sent. If not, nothing is sent.
//! - `dds`, `discovery`: topics, readers and writers, and who else is there.
//! - [`port`]: the port of `crates/driver`, wait-free.

#![allow(clippy::neg_cmp_op_on_partial_ord, reason = "NaN differs from everything")]
#![allow(clippy::needless_range_loop, reason = "a joint index runs over several arrays at once")]

pub mod cli;
pub mod clock;
pub mod connection;
mod curves;
mod dds;
pub mod description;
mod discovery;
mod emergency;
pub mod estimate;
pub mod gravity;
pub mod hands;
pub mod interface;
pub mod lag;
pub mod port;
pub mod preflight;
pub mod reference;
pub mod ros;
pub mod stream;
pub mod trajectory;
pub mod unitree;
mod wire;
