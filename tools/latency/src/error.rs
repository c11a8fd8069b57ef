//! Errors that keep a measurement from beginning, or make it invalid.

use rt::{Exit, Failure};
use std::fmt::Display;

/// The run ended, but one of its conditions was violated.
pub(crate) fn invalid(text: impl Display) -> Failure {
    Failure::new(Exit::Failed, text)
}

/// The reference cannot be measured.
pub(crate) fn unmeasured(program: impl Display, cause: impl Display) -> Failure {
    Failure::new(Exit::Software, format!("{program}: {cause}"))
}
