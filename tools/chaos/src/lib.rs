//! Kills (SIGKILL) and suspends (SIGSTOP, SIGCONT) the real processes, a client and an operator at random moments of a
//! moving robot, and watches from outside that it comes to rest, breaks no limit on the way, and moves no more before
//! somebody engages it anew.
//!
//! - [`cli`]: what is asked for.
//! - [`blow`]: who is struck, how and when.
//! - [`rig`]: the processes, a client, an operator.
//! - [`witness`]: what the driver executes, seen over shared memory and held against the limits.
//! - [`trial`]: one blow and what came of it.
//! - [`figures`]: what the trials amount to, as JSON and in words.

pub mod cli;
pub mod error;
pub mod figures;
pub mod injection;
pub mod monitor;
pub mod rig;
pub mod trial;
