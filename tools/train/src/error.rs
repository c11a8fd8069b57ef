//! Errors before, between and after the steps.

use rt::{Exit, Failure};
use std::path::PathBuf;

#[derive(Debug, thiserror::Error)]
pub enum TrainError {
    #[error("{path}: cannot {action}: {source}")]
    File { path: PathBuf, action: &'static str, source: std::io::Error },
    #[error("{folder}: {usable} of {found} motion files are usable, at least {needed} are needed{reasons}")]
    TooFewClips { folder: PathBuf, found: usize, usable: usize, needed: usize, reasons: String },
    #[error("{0}")]
    Robot(#[from] robot::RobotError),
    #[error("{path}: {reason}")]
    Baseline { path: PathBuf, reason: String },
    #[error("{path}: {reason}")]
    Pairs { path: PathBuf, reason: String },
    #[error("{path}: is for an arm of hash {theirs}, not {ours}")]
    OtherArm { path: PathBuf, theirs: String, ours: String },
    #[error("weights: {0}")]
    Compose(#[from] retarget::WriteError),
    #[error("--{option} is {value}, expected {expected}")]
    Option { option: &'static str, value: String, expected: String },
    #[error("the loss is not finite at step {step}; a lower learning rate or another seed may help")]
    Diverged { step: u64 },
}

impl TrainError {
    pub fn exit(&self) -> Exit {
        match self {
            Self::File { action: "write", .. } => Exit::CantCreate,
            Self::File { .. } => Exit::NoInput,
            Self::TooFewClips { .. } | Self::Baseline { .. } | Self::Pairs { .. } | Self::OtherArm { .. } => {
                Exit::DataErr
            }
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
