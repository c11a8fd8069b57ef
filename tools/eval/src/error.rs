//! Errors that make a measurement impossible.

use rt::Exit;
use std::path::PathBuf;

/// An error that prevents the table.
#[derive(Debug, thiserror::Error)]
pub enum EvalError {
    /// A file or folder cannot be read or written.
    #[error("{path}: cannot {action}: {source}")]
    File {
        /// The file.
        path: PathBuf,
        /// The attempted action: "read", "write", "list".
        action: &'static str,
        /// The system's reason.
        source: std::io::Error,
    },
    /// Nothing in the folder can be measured.
    #[error("{folder}: none of {found} motion files can be used{reasons}")]
    NoClips {
        /// The folder.
        folder: PathBuf,
        /// Number of files with a readable extension.
        found: usize,
        /// A line for each unusable file.
        reasons: String,
    },
    /// A requested clip does not exist, or cannot be used.
    #[error("--clips names {name}: {reason}")]
    Clip {
        /// The clip.
        name: String,
        /// The reason.
        reason: String,
    },
    /// A requested method has no weights.
    #[error("--methods names {name}, but {reason}; make it with: {command}")]
    Missing {
        /// The method.
        name: String,
        /// The missing part.
        reason: String,
        /// The command that makes it.
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
    /// A weights file is invalid.
    #[error("{path}: {source}")]
    Weights {
        /// The tensors' file.
        path: PathBuf,
        /// The reason.
        source: retarget::WeightsError,
    },
    /// The robot file or learned weights are invalid.
    #[error("{0}")]
    Train(#[from] train::error::TrainError),
    /// The daemon's settings, or a file that they name, are invalid.
    #[error("{0}")]
    Config(#[from] config::ConfigError),
    /// A motion could not be played through the stages.
    #[error("{name}: {reason}")]
    Play {
        /// The motion.
        name: String,
        /// The reason.
        reason: String,
    },
    /// A URDF has no masses, which the torques need.
    #[error("{path}: {reason}")]
    Masses {
        /// The file.
        path: PathBuf,
        /// The reason.
        reason: String,
    },
    /// A plot could not be drawn.
    #[error("{path}: cannot draw: {reason}")]
    Plot {
        /// The file.
        path: PathBuf,
        /// The reason.
        reason: String,
    },
}

impl EvalError {
    /// Returns the exit code.
    #[must_use]
    pub fn exit(&self) -> Exit {
        match self {
            Self::File { action: "write", .. } | Self::Plot { .. } => Exit::CantCreate,
            Self::File { .. } | Self::Missing { .. } => Exit::NoInput,
            Self::NoClips { .. } | Self::Weights { .. } => Exit::DataErr,
            Self::Clip { .. } | Self::Option { .. } => Exit::Usage,
            Self::Config(_) | Self::Masses { .. } | Self::Play { .. } => Exit::Config,
            Self::Train(error) => error.exit(),
        }
    }
}
