//! Errors. The texts name file, place, value and bound.

use std::path::{Path, PathBuf};

/// Reason for which a pose or a trajectory was refused.
#[derive(Debug, thiserror::Error)]
pub enum PosesError {
    /// A file cannot be read.
    #[error("{}", rt::unreadable(.path, .source))]
    File {
        /// The file.
        path: PathBuf,
        /// The system's error.
        source: std::io::Error,
    },
    /// A motion file is invalid.
    #[error("{}", refused(.0))]
    Motion(#[from] motion::MotionError),
    /// A pose of the command line does not exist.
    #[error("pose {text}: {reason}")]
    Pose {
        /// The text of the pose.
        text: String,
        /// The problem, and the allowed values.
        reason: String,
    },
    /// A trajectory is invalid.
    #[error("{}:{line}: {reason}", .path.display())]
    Trajectory {
        /// The file.
        path: PathBuf,
        /// Line, from 1.
        line: usize,
        /// The problem, with value and bound.
        reason: String,
    },
}

impl PosesError {
    /// Returns a function for `map_err` that makes the error of a file.
    pub fn file(path: &Path) -> impl FnOnce(std::io::Error) -> Self + '_ {
        |source| Self::File { path: path.to_path_buf(), source }
    }
}

/// Returns the reason why a motion file is refused, and the remedy if the system refuses it.
pub fn refused(error: &motion::MotionError) -> String {
    match error {
        motion::MotionError::Io { file, source } => rt::unreadable(Path::new(file), source),
        error => error.to_string(),
    }
}
