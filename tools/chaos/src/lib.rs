//! Kills (SIGKILL) and suspends (SIGSTOP, SIGCONT) the real processes, a client and an operator at random
//! moments while the robot moves. Watches from outside that the robot comes to rest and breaks no limit on the
//! way. Also checks that it does not move again before the operator engages it again.

#![allow(missing_docs, reason = "only the program uses the library")]

pub mod cli;
pub mod figures;
pub mod injection;
pub mod monitor;
pub mod rig;
pub mod soak;
pub mod trial;
