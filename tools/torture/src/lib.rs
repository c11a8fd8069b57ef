//! Attacks whole-body control and the gate for many ticks, and judges what the driver executes. The judges
//! share no arithmetic with these stages. The simulated robot's checker judges every executed step. `judge` attacks,
//! and rolls stop plans out to rest.
//!
//! - [`stages`]: the two stages as the daemon runs them, timed.
//! - [`chunk`]: one run of an attack, with missed ticks, lost commands and a driver that is suspended.
//! - [`goals`]: how many random safe postures are reached.
//! - [`stop_times`]: the longest stop of any state, against its bound.
//! - [`motions`]: recorded motions through every stage, offline.
//! - [`bench`](mod@bench): the duration of the control tick.

#![recursion_limit = "256"]
#![allow(clippy::needless_range_loop, reason = "a joint index runs over several arrays at once")]

pub mod bench;
pub mod chunk;
pub mod cli;
mod error;
pub mod figures;
pub mod goals;
pub mod motions;
pub mod report;
pub mod stages;
pub mod stop_times;
