//! Why a measurement cannot begin, or is not valid.

use std::path::{Path, PathBuf};

/// Why a measurement cannot begin, or is not valid. The text names file, option, value and bound.
#[derive(Debug, thiserror::Error)]
pub enum LatencyError {
    /// An option out of its bounds.
    #[error("{option} {value}: {bound}")]
    Option {
        /// The option.
        option: &'static str,
        /// Its value.
        value: String,
        /// What it must be.
        bound: String,
    },
    /// `--compare cyclictest`, and there is none.
    #[error(
        "cyclictest is not on the PATH, or the policy is not fifo; install the package rt-tests, or leave --compare away"
    )]
    NoCyclictest,
    /// Settings, robot or weights are refused.
    #[error(transparent)]
    Config(#[from] pipeline::ConfigError),
    /// The settings cannot be changed to what a block needs.
    #[error("{file}: {cause}")]
    Settings {
        /// The file.
        file: PathBuf,
        /// Why.
        cause: String,
    },
    /// A process of teleopd cannot start.
    #[error("{}", .0.text)]
    Start(teleopd::Failure),
    /// The client cannot publish.
    #[error(transparent)]
    Bus(#[from] bus::BusError),
    /// The reference cannot be measured.
    #[error("{program}: {cause}")]
    Reference {
        /// The program.
        program: String,
        /// Why.
        cause: String,
    },
    /// The run ended, and something in it was not as it must be.
    #[error("{0}")]
    Invalid(String),
    /// A soak's processes, or whom it strikes.
    #[error(transparent)]
    Chaos(#[from] chaos::error::ChaosError),
    /// A signal ended the run.
    #[error("interrupted; the robot was stopped")]
    Interrupted,
    /// A file cannot be written.
    #[error("{file}: {cause}")]
    Write {
        /// The file.
        file: PathBuf,
        /// Why.
        cause: String,
    },
}

impl LatencyError {
    pub(crate) fn write(file: &Path, cause: impl std::fmt::Display) -> Self {
        Self::Write { file: file.to_path_buf(), cause: cause.to_string() }
    }

    pub(crate) fn reference(program: impl Into<String>, cause: impl std::fmt::Display) -> Self {
        Self::Reference { program: program.into(), cause: cause.to_string() }
    }

    /// Exit code, of sysexits(3) where it has one.
    pub fn exit(&self) -> u8 {
        match self {
            Self::Option { .. } => 64,
            Self::NoCyclictest => 69,
            Self::Config(_) | Self::Settings { .. } => 78,
            Self::Start(failure) => failure.exit as u8,
            Self::Bus(_) => 69,
            Self::Reference { .. } => 70,
            Self::Invalid(_) => 1,
            Self::Chaos(error) => error.exit(),
            Self::Interrupted => 130,
            Self::Write { .. } => 73,
        }
    }
}

impl From<teleopd::Failure> for LatencyError {
    fn from(failure: teleopd::Failure) -> Self {
        Self::Start(failure)
    }
}
