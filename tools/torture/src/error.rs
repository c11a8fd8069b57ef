//! Why a run cannot begin or end.

use std::path::{Path, PathBuf};

/// Why a run cannot begin or end. The text names file, option, value and bound.
#[derive(Debug, thiserror::Error)]
pub enum TortureError {
    /// An option out of its bounds.
    #[error("{option} = {value}: {bound}")]
    Option {
        /// The option.
        option: &'static str,
        /// Its value.
        value: String,
        /// What it must be.
        bound: String,
    },
    /// Settings, robot or weights are refused.
    #[error(transparent)]
    Config(#[from] pipeline::ConfigError),
    /// Settings with an interface that is not attacked.
    #[error("{file}: sim.interface = \"{value}\", must be \"direct\": no other is attacked here")]
    Interface {
        /// The settings file.
        file: PathBuf,
        /// The interface.
        value: &'static str,
    },
    /// A stage refuses the robot.
    #[error("{file}: {stage}: {cause}")]
    Stage {
        /// The robot file.
        file: PathBuf,
        /// The stage.
        stage: &'static str,
        /// Why.
        cause: String,
    },
    /// A folder of motions cannot be listed.
    #[error(transparent)]
    Motion(#[from] motion::MotionError),
    /// A folder without motion files.
    #[error("{0}: no motion files (.bvh, .npy, .npz) in it")]
    NoMotions(PathBuf),
    /// A file cannot be written.
    #[error("{file}: {cause}")]
    Write {
        /// The file.
        file: PathBuf,
        /// Why.
        cause: std::io::Error,
    },
}

impl TortureError {
    pub(crate) fn stage(file: &Path, stage: &'static str, cause: impl std::fmt::Display) -> Self {
        Self::Stage { file: file.to_path_buf(), stage, cause: cause.to_string() }
    }
}
