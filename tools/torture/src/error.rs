//! Failures of a run, with their exit codes.

use rt::{Exit, Failure};
use std::fmt::Display;
use std::path::Path;

/// An option is out of its bounds.
pub(crate) fn bad_option(option: &str, value: impl Display, bound: impl Display) -> Failure {
    Failure::new(Exit::Usage, format!("{option} = {value}: must be {bound}"))
}

/// A stage, or torture itself, rejects the robot or the settings of a file.
pub(crate) fn rejected(file: &Path, cause: impl Display) -> Failure {
    Failure::new(Exit::Config, format!("{}: {cause}", file.display()))
}
