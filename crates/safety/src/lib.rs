//! Decides whether the robot may move, and refuses what must not be sent. Never proposes a motion, never does IO, reads
//! no clock, never allocates, locks or panics in a tick, and depends on no other stage.
//!
//! - [`engage`]: the state machine that gives and withdraws authority.
//! - [`gate`]: the last check of every command, in integers; a denial makes all joints play the stored stop plan.
//! - [`clearance`]: plain distances of the capsule model, with arithmetic of its own.
//! - [`monitor`]: turns measurements into the flags that `engage` judges.
//!
//! Words: a *stop* is the certified plan that travelled with the last command; *authority* is the operator's permission
//! to move, granted by an edge and withdrawn by a level; a *seed* is the state the driver says it is in.

pub mod clearance;
pub mod engage;
pub mod gate;
pub mod monitor;
