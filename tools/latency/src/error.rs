//! Errors that keep a measurement from beginning, or make it invalid.

use std::path::{Path, PathBuf};

/// An error that keeps a measurement from beginning, or makes it invalid. The text names file, option, value
/// and bound.
#[derive(Debug, thiserror::Error)]
pub enum LatencyError {
    /// An option is out of its bounds.
    #[error("{option} {value}: {bound}")]
    Option {
        /// The option.
        option: &'static str,
        /// Its value.
        value: String,
        /// The allowed value.
        bound: String,
    },
    /// `--compare cyclictest` is given, but cyclictest cannot be used.
    #[error(
        "cyclictest is not on the PATH, or the policy is not fifo; install the package rt-tests, or omit --compare"
    )]
    NoCyclictest,
    /// Settings, robot or weights are invalid.
    #[error(transparent)]
    Config(#[from] config::ConfigError),
    /// The settings cannot be changed to what a block needs.
    #[error("{file}: {cause}")]
    Settings {
        /// The file.
        file: PathBuf,
        /// The reason.
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
        /// The reason.
        cause: String,
    },
    /// The run ended, but one of its conditions was violated.
    #[error("{0}")]
    Invalid(String),
    /// A process of a soak cannot start or run, or a fault cannot be injected.
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
        /// The reason.
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

    /// Exit code. It is from sysexits(3) where that has one.
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
