//! Errors. The texts name file, place, value and bound.

use std::path::{Path, PathBuf};

/// Reason for which a pose or a trajectory was refused.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs, reason = "the texts name the fields")]
pub enum PosesError {
    #[error("{}", rt::unreadable(.path, .source))]
    File { path: PathBuf, source: std::io::Error },
    #[error("{}", refused(.0))]
    Motion(#[from] motion::MotionError),
    #[error("pose {text}: {reason}")]
    Pose { text: String, reason: String },
    #[error("{}:{line}: {reason}", .path.display())]
    Trajectory { path: PathBuf, line: usize, reason: String },
}

impl PosesError {
    /// Returns a function for `map_err` that makes the error of a file.
    pub fn file(path: &Path) -> impl FnOnce(std::io::Error) -> Self + '_ {
        |source| Self::File { path: path.to_path_buf(), source }
    }
}

/// Returns the failure of a program whose motion file is refused.
pub fn failure(error: &motion::MotionError) -> rt::Failure {
    let is_unused = matches!(error, motion::MotionError::Unused { .. });
    rt::Failure::new(if is_unused { rt::Exit::Usage } else { rt::Exit::NoInput }, refused(error))
}

/// Returns the reason why a motion file is refused, and the remedy if the system refuses it.
pub fn refused(error: &motion::MotionError) -> String {
    match error {
        motion::MotionError::Io { file, source } => rt::unreadable(Path::new(file), source),
        error => error.to_string(),
    }
}
