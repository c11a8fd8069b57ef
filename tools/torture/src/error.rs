//! Failures of a run, with their exit codes.

use rt::{Exit, Failure};
use std::fmt::Display;
use std::path::Path;

/// A stage, or torture itself, rejects the robot or the settings of a file.
pub(crate) fn rejected(file: &Path, cause: impl Display) -> Failure {
    Failure::new(Exit::Config, format!("{}: {cause}", file.display()))
}
