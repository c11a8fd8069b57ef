//! Decides whether the robot may move and denies unsafe commands, but never proposes a motion. It does no IO
//! and reads no clock. A tick never allocates, locks or panics. The crate depends on no other stage.
//!
//! - [`engage`]: the state machine that grants and withdraws authority.
//! - [`gate`]: the last check of every command, in integers. After a denial all joints play the stored stop
//!   plan.
//! - [`gripper`]: the same for the grippers, which have no plan: they brake.
//! - [`clearance`]: distances of the capsule model, with an implementation of its own.
//! - [`monitor`]: turns measurements into the flags that `engage` judges.
//!
//! Terms:
//!
//! - A *stop* is the certified plan that came with the last command.
//! - *Authority* is the operator's permission to move. An edge grants it, and a level withdraws it.
//! - A *seed* is the state that the driver reports to be in.

#![forbid(clippy::disallowed_macros, clippy::disallowed_methods, clippy::disallowed_types)]

pub mod clearance;
pub mod engage;
pub mod gate;
pub mod gripper;
pub mod monitor;
