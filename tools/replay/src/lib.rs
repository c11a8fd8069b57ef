//! Plays motions, and makes them: `replay` with its subcommands `batch`, `keyposes` and `say`.

#![allow(missing_docs, reason = "the library of a program: only the program, tests and other tools use it")]

pub mod batch;
pub mod cli;
pub mod keyposes;
pub mod play;
pub mod say;
