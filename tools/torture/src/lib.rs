//! Attacks whole-body control and the gate for many ticks, and judges what the driver executes. The judges
//! share no arithmetic with these stages. The simulated robot's checker judges every executed step. `judge` attacks,
//! and rolls stop plans out to rest.

#![recursion_limit = "256"]
#![allow(clippy::needless_range_loop, reason = "a joint index runs over several arrays at once")]
#![allow(missing_docs, reason = "only the program and its tests use the library")]

pub mod chunk;
pub mod cli;
pub mod figures;
pub mod goals;
pub mod report;
pub mod stages;
pub mod stop_times;
