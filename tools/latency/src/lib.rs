//! Measures how long a skeleton takes to become a command, hop by hop, with the real processes. The references
//! for comparison run in the same run.

#![allow(missing_docs, reason = "only the program and the package's man pages use the library")]

pub mod blocks;
pub mod cli;
pub mod client;
pub mod distribution;
pub mod figures;
pub mod host;
pub mod load;
pub mod measured;
pub mod processes;
pub mod reference;
pub mod report;
pub mod run;
pub mod settings;
