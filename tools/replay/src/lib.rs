//! Plays motions, and makes them: `replay` with its subcommands `batch`, `keyposes` and `say`.

pub mod batch;
pub mod cli;
pub mod keyposes;
pub mod play;
pub mod say;
