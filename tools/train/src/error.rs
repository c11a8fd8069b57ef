//! Errors before, between and after the steps.

use rt::{Exit, Failure};
use std::path::PathBuf;

/// An error that keeps training or evaluation from starting or going on.
#[derive(Debug, thiserror::Error)]
pub enum TrainError {
    /// A file cannot be read or written.
    #[error("{path}: cannot {action}: {source}")]
    File {
        /// The file.
        path: PathBuf,
        /// The attempted action: "read", "write", "list".
        action: &'static str,
        /// The system's reason.
        source: std::io::Error,
    },
    /// The folder of motion files has too few of them.
    #[error("{folder}: {usable} of {found} motion files are usable, at least {needed} are needed{reasons}")]
    TooFewClips {
        /// The folder.
        folder: PathBuf,
        /// Files with the extension .bvh.
        found: usize,
        /// Number of these files that have arm poses.
        usable: usize,
        /// Number that is enough for one validation clip.
        needed: usize,
        /// A line for each unusable file.
        reasons: String,
    },
    /// The robot file or its URDF is invalid.
    #[error("{0}")]
    Robot(#[from] robot::RobotError),
    /// A baseline's file is damaged.
    #[error("{path}: {reason}")]
    Baseline {
        /// Its path without extension.
        path: PathBuf,
        /// The mismatch.
        reason: String,
    },
    /// A baseline was trained for another arm.
    #[error("{path}: is for an arm of hash {theirs}, not {ours}")]
    OtherArm {
        /// Its path without extension.
        path: PathBuf,
        /// Hash of its arm.
        theirs: String,
        /// Hash of the arm in use.
        ours: String,
    },
    /// A weights file could not be composed.
    #[error("weights: {0}")]
    Compose(#[from] retarget::WriteError),
    /// A checkpoint is damaged, or belongs to another run.
    #[error("{path}: {reason}")]
    Checkpoint {
        /// The file.
        path: PathBuf,
        /// The mismatch.
        reason: String,
    },
    /// A value of the command line is out of bounds.
    #[error("--{option} is {value}, expected {expected}")]
    Option {
        /// Its name.
        option: &'static str,
        /// Its value.
        value: String,
        /// The bound.
        expected: String,
    },
    /// The loss became NaN or infinite.
    #[error("the loss is not finite at step {step}; a lower learning rate or another seed may help")]
    Diverged {
        /// Number of steps done.
        step: u64,
    },
}

impl TrainError {
    /// Returns the exit code.
    #[must_use]
    pub fn exit(&self) -> Exit {
        match self {
            Self::File { action: "write", .. } => Exit::CantCreate,
            Self::File { .. } => Exit::NoInput,
            Self::TooFewClips { .. } | Self::Checkpoint { .. } => Exit::DataErr,
            Self::Baseline { .. } | Self::OtherArm { .. } => Exit::DataErr,
            Self::Robot(_) => Exit::Config,
            Self::Option { .. } => Exit::Usage,
            Self::Compose(_) | Self::Diverged { .. } => Exit::Software,
        }
    }
}

impl From<TrainError> for Failure {
    fn from(error: TrainError) -> Self {
        Self::new(error.exit(), error)
    }
}
