//! What can make a measurement impossible.

use std::path::PathBuf;

/// Why there is no table.
#[derive(Debug, thiserror::Error)]
pub enum EvalError {
    /// A file or folder cannot be read or written.
    #[error("{path}: cannot {action}: {source}")]
    File {
        /// The file.
        path: PathBuf,
        /// What was tried: "read", "write", "list".
        action: &'static str,
        /// The system's reason.
        source: std::io::Error,
    },
    /// Nothing in the folder can be measured.
    #[error("{folder}: none of {found} motion files can be used{reasons}")]
    NoClips {
        /// The folder.
        folder: PathBuf,
        /// Files of a readable extension.
        found: usize,
        /// A line for each unusable file.
        reasons: String,
    },
    /// A clip that was asked for is not there, or cannot be used.
    #[error("--clips names {name}: {reason}")]
    Clip {
        /// The clip.
        name: String,
        /// Why not.
        reason: String,
    },
    /// A method that was asked for has no weights.
    #[error("--methods names {name}, but {reason}; make it with: {command}")]
    Missing {
        /// The method.
        name: String,
        /// What is missing.
        reason: String,
        /// What makes it.
        command: String,
    },
    /// A value of the command line cannot be used.
    #[error("--{option} is {value}, expected {expected}")]
    Option {
        /// Its name.
        option: &'static str,
        /// Its value.
        value: String,
        /// The bound.
        expected: String,
    },
    /// A weights file was refused.
    #[error("{path}: {source}")]
    Weights {
        /// The tensors' file.
        path: PathBuf,
        /// Why.
        source: retarget::WeightsError,
    },
    /// The robot file or learned weights were refused.
    #[error("{0}")]
    Train(#[from] train::error::TrainError),
    /// The daemon's settings, or a file that they name, were refused.
    #[error("{0}")]
    Config(#[from] pipeline::ConfigError),
    /// A URDF has no masses that torques could be computed with.
    #[error("{path}: {reason}")]
    Masses {
        /// The file.
        path: PathBuf,
        /// Why.
        reason: String,
    },
    /// A plot could not be drawn.
    #[error("{path}: cannot draw: {reason}")]
    Plot {
        /// The file.
        path: PathBuf,
        /// Why.
        reason: String,
    },
}

impl EvalError {
    /// The exit code of sysexits.h.
    #[must_use]
    pub fn exit_code(&self) -> u8 {
        match self {
            Self::File { action: "write", .. } | Self::Plot { .. } => 73,
            Self::File { .. } | Self::Missing { .. } => 66,
            Self::NoClips { .. } | Self::Weights { .. } => 65,
            Self::Clip { .. } | Self::Option { .. } => 64,
            Self::Config(_) | Self::Masses { .. } => 78,
            Self::Train(error) => error.exit_code(),
        }
    }
}
