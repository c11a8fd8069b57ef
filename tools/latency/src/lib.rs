//! Measures how long a skeleton takes to become a command, hop by hop, with the real processes. The references
//! for comparison run in the same run.
//!
//! - [`cli`], [`settings`], [`load`], [`host`]: the options, and the machine.
//! - [`blocks`], [`run`](mod@run): the order of the measurements.
//! - [`processes`], [`client`]: a block of the real processes.
//! - [`reference`](mod@reference): a block of the bare timer.
//! - [`distribution`], [`figures`], [`measured`]: the results.
//! - [`report`], [`plot`]: text and picture of the results.

pub mod blocks;
pub mod cli;
pub mod client;
pub mod distribution;
mod error;
pub mod figures;
pub mod host;
pub mod load;
pub mod measured;
pub mod observers;
pub mod plot;
pub mod processes;
pub mod reference;
pub mod report;
pub mod run;
pub mod settings;
pub mod watched;
