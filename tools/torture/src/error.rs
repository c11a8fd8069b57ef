//! Errors that keep a run from beginning or ending.

use std::path::{Path, PathBuf};

/// An error that keeps a run from beginning or ending. The text names file, option, value and bound.
#[derive(Debug, thiserror::Error)]
pub enum TortureError {
    /// An option is out of its bounds.
    #[error("{option} = {value}: {bound}")]
    Option {
        /// The option.
        option: &'static str,
        /// Its value.
        value: String,
        /// The allowed value.
        bound: String,
    },
    /// Settings, robot or weights are invalid.
    #[error(transparent)]
    Config(#[from] config::ConfigError),
    /// The settings name an interface that torture does not attack.
    #[error("{file}: sim.interface = \"{value}\", must be \"direct\"; no other interface is tested")]
    Interface {
        /// The settings file.
        file: PathBuf,
        /// The interface.
        value: &'static str,
    },
    /// A stage rejects the robot.
    #[error("{file}: {stage}: {cause}")]
    Stage {
        /// The robot file.
        file: PathBuf,
        /// The stage.
        stage: &'static str,
        /// The reason.
        cause: String,
    },
    /// A folder of motions cannot be listed.
    #[error(transparent)]
    Motion(#[from] motion::MotionError),
    /// The folder has no motion files.
    #[error("{0}: no motion files (.bvh, .npy, .npz) in it")]
    NoMotions(PathBuf),
    /// A file cannot be written.
    #[error("{file}: {cause}")]
    Write {
        /// The file.
        file: PathBuf,
        /// The reason.
        cause: std::io::Error,
    },
}

impl TortureError {
    pub(crate) fn stage(file: &Path, stage: &'static str, cause: impl std::fmt::Display) -> Self {
        Self::Stage { file: file.to_path_buf(), stage, cause: cause.to_string() }
    }
}
