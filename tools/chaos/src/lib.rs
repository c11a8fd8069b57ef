//! Kills (SIGKILL) and suspends (SIGSTOP, SIGCONT) the real processes, a client and an operator at random
//! moments while the robot moves. Watches from outside that the robot comes to rest and breaks no limit on the
//! way. Also checks that it does not move again before the operator engages it again.
//!
//! - [`cli`]: the options.
//! - [`injection`]: target, kind and moment of a fault.
//! - [`rig`]: the processes, a client, an operator.
//! - [`monitor`]: reads what the driver executes over shared memory, and checks it against the limits.
//! - [`trial`]: one fault and its outcome.
//! - [`figures`]: sums up the trials, as JSON and as text.
//! - [`soak`]: hours of running, with a fault every minute.

pub mod cli;
pub mod figures;
pub mod injection;
pub mod monitor;
pub mod rig;
pub mod soak;
pub mod trial;
