//! The joint order, the same everywhere: torso lift, head 1-2, left arm 1-7, right arm 1-7.

use core::ops::Range;

/// Number of commanded joints.
pub const JOINTS: usize = 17;
/// Joints of one arm.
pub const ARM_JOINTS: usize = 7;
/// Index of the torso lift.
pub const TORSO: usize = 0;
/// Indices of the head joints.
pub const HEAD: Range<usize> = 1..3;
/// Indices of the left arm's joints 1 to 7.
pub const LEFT_ARM: Range<usize> = 3..10;
/// Indices of the right arm's joints 1 to 7.
pub const RIGHT_ARM: Range<usize> = 10..17;
/// A valid mask with every joint set.
pub const ALL_JOINTS: u32 = (1 << JOINTS) - 1;
