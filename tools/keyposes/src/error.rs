//! Errors. The texts name file, place, value and bound.

use std::path::{Path, PathBuf};

/// An error that ends a command without its result.
#[derive(Debug, thiserror::Error)]
pub enum KeyposesError {
    /// A file cannot be read.
    #[error("{}", rt::unreadable(.path, .source))]
    File {
        /// The file.
        path: PathBuf,
        /// The system's error.
        source: std::io::Error,
    },
    /// A file or folder cannot be written.
    #[error("{}", rt::unwritable(.path, .source))]
    Write {
        /// The file or folder.
        path: PathBuf,
        /// The system's error.
        source: std::io::Error,
    },
    /// The output would overwrite an input.
    #[error("{}: is one of the inputs; give another --out", .path.display())]
    OverInput {
        /// The file.
        path: PathBuf,
    },
    /// A motion file is invalid.
    #[error("{}", refused(.0))]
    Motion(#[from] motion::MotionError),
    /// Settings, robot or weights are invalid.
    #[error(transparent)]
    Config(#[from] pipeline::ConfigError),
    /// A pose of the command line does not exist.
    #[error("pose {text}: {reason}")]
    Pose {
        /// The text of the pose.
        text: String,
        /// The problem, and the allowed values.
        reason: String,
    },
    /// An option is out of its bounds.
    #[error("{option} {value} is outside [{low}, {high}]")]
    Range {
        /// The option.
        option: &'static str,
        /// Its value.
        value: f64,
        /// Lowest value allowed.
        low: f64,
        /// Highest value allowed.
        high: f64,
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

impl KeyposesError {
    /// Returns the exit code of sysexits(3).
    #[must_use]
    pub fn exit_code(&self) -> u8 {
        match self {
            Self::Pose { .. } | Self::Range { .. } | Self::OverInput { .. } => 64,
            Self::Trajectory { .. } => 65,
            Self::File { .. } | Self::Motion(_) => 66,
            Self::Write { .. } => 73,
            Self::Config(_) => 78,
        }
    }

    /// Returns a function for `map_err` that makes the error of a file.
    pub fn file(path: &Path) -> impl FnOnce(std::io::Error) -> Self + '_ {
        |source| Self::File { path: path.to_path_buf(), source }
    }
}

/// Why a motion file is refused, and what to do where the system refuses it.
fn refused(error: &motion::MotionError) -> String {
    match error {
        motion::MotionError::Io { file, source } => rt::unreadable(Path::new(file), source),
        error => error.to_string(),
    }
}

/// Returns `value` if it is within the bounds. NaN is not.
pub(crate) fn within(option: &'static str, value: f64, low: f64, high: f64) -> Result<f64, KeyposesError> {
    if (low..=high).contains(&value) { Ok(value) } else { Err(KeyposesError::Range { option, value, low, high }) }
}
