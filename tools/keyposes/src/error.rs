//! Errors. The texts name file, place, value and bound.

use poses::error::PosesError;
use rt::Exit;
use std::path::PathBuf;

/// An error that ends a command without its result.
#[derive(Debug, thiserror::Error)]
pub enum KeyposesError {
    /// A pose or a trajectory is invalid.
    #[error(transparent)]
    Poses(#[from] PosesError),
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
    #[error("{}", poses::error::refused(.0))]
    Motion(#[from] motion::MotionError),
    /// Settings, robot or weights are invalid.
    #[error(transparent)]
    Config(#[from] config::ConfigError),
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
}

impl KeyposesError {
    /// Returns the exit code.
    #[must_use]
    pub fn exit(&self) -> Exit {
        match self {
            Self::Poses(PosesError::Pose { .. }) | Self::Range { .. } | Self::OverInput { .. } => Exit::Usage,
            Self::Poses(PosesError::Trajectory { .. }) => Exit::DataErr,
            Self::Poses(PosesError::File { .. } | PosesError::Motion(_)) | Self::Motion(_) => Exit::NoInput,
            Self::Write { .. } => Exit::CantCreate,
            Self::Config(_) => Exit::Config,
        }
    }
}

/// Returns `value` if it is within the bounds. NaN is not.
pub(crate) fn within(option: &'static str, value: f64, low: f64, high: f64) -> Result<f64, KeyposesError> {
    if (low..=high).contains(&value) { Ok(value) } else { Err(KeyposesError::Range { option, value, low, high }) }
}
