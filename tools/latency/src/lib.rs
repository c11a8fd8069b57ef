//! Measures how long a skeleton takes to become a command, hop by hop, with the real processes and in one run beside
//! what it is compared with.
//!
//! - [`cli`], [`settings`], [`load`], [`host`]: what is asked for, and on what machine.
//! - [`blocks`], [`run`](mod@run): who is measured when.
//! - [`processes`], [`client`]: a block of the real processes.
//! - [`reference`](mod@reference): a block of the bare timer.
//! - [`distribution`], [`figures`], [`measured`]: what comes of it.
//! - [`report`], [`plot`]: how it is told.
//! - [`soak`]: hours of it, with somebody struck every minute.

pub mod blocks;
pub mod cli;
pub mod client;
pub mod distribution;
pub mod error;
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
pub mod soak;
pub mod watched;
