//! The joints of a robot in messages: its body joints first, then its left arm, then its right arm.

use crate::layout::message;
use core::fmt;

/// Largest number of commanded joints that a message can carry. Arrays of joints have this length: beyond the
/// robot's own number, every element is zero.
pub const JOINTS_MAX: usize = 24;
/// Largest number of joints of one arm: three turn the upper arm, two the forearm, three the hand.
pub const ARM_JOINTS: usize = 8;
/// A valid mask with every joint of every robot set. Bits beyond a robot's own joints mean nothing.
pub const ALL_JOINTS: u32 = (1 << JOINTS_MAX) - 1;

message! {
    /// The robot that a message is about. It tells number and order of the joints.
    pub struct RobotId v 1 size 16 {
        /// `Model::hash`: equal hashes mean equal robot files and URDFs, so equal joints in the same order.
        pub hash: u64,
        /// Number of commanded joints.
        pub joint_count: u32,
        /// Zero.
        pub reserved: u32,
    }
}

impl fmt::Display for RobotId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "robot {:016x} with {} joints", self.hash, self.joint_count)
    }
}
