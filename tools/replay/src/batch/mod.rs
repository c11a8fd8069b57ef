//! Retargets a folder of motion files to joint trajectories, on all cores. It applies the retargeting's own
//! functions frame by frame. The results do not depend on the number of jobs. The outputs are targets, before
//! whole-body control and before the safety gate: postures, not a motion. With `--certified` they are the commands after both.

mod certified;
mod cli;
mod manifest;
mod output;
mod program;
mod run;

pub use cli::{Cli, Method};
pub use output::Format;
pub use poses::postures::Postures;
pub use program::execute;
pub use run::{Summary, run};

use rt::{Exit, Failure};
use std::path::Path;

/// Returns a function for `map_err` that names a file or a folder, and what to do about it.
fn failed(path: &Path, action: &'static str) -> impl FnOnce(std::io::Error) -> Failure {
    move |error| match action {
        "read" => Failure::new(Exit::NoInput, rt::unreadable(path, &error)),
        _ => Failure::unwritable(path, &error),
    }
}
