//! Errors that keep chaos from beginning or going on.

use std::path::{Path, PathBuf};

/// An error that keeps chaos from beginning or going on. The text names file, option, value and bound.
#[derive(Debug, thiserror::Error)]
pub enum ChaosError {
    /// An option is out of its bounds.
    #[error("{option} {value} is outside [{low}, {high}]")]
    Option {
        /// The option.
        option: &'static str,
        /// Its value.
        value: u64,
        /// Lowest value allowed.
        low: u64,
        /// Highest value allowed.
        high: u64,
    },
    /// A share is out of its bounds.
    #[error("{option} {value} is outside [0, 1]")]
    Share {
        /// The option.
        option: &'static str,
        /// Its value.
        value: f64,
    },
    /// No target has this name.
    #[error("--only {0}: must be ingest, retarget, control, sim, client or operator")]
    Target(String),
    /// Settings, robot or weights are invalid.
    #[error(transparent)]
    Config(#[from] config::ConfigError),
    /// A process of teleopd does not start, or its operator socket does not answer.
    #[error("{}", .0.text)]
    Start(teleopd::Failure),
    /// The shared memory cannot be read.
    #[error(transparent)]
    Bus(#[from] bus::BusError),
    /// The client cannot publish.
    #[error(transparent)]
    Client(#[from] client::ClientError),
    /// A process cannot be started or signalled, or a file cannot be written.
    #[error("{what}: {cause}")]
    Os {
        /// The attempted action.
        what: String,
        /// The system's error text.
        cause: String,
    },
    /// The robot does not reach a state from which the next trial can begin.
    #[error("{0}")]
    Stuck(String),
    /// A signal ended the run.
    #[error("interrupted; the robot was stopped")]
    Interrupted,
}

impl ChaosError {
    /// Creates the error of a failed system call.
    pub fn os(what: impl Into<String>, cause: impl std::fmt::Display) -> Self {
        Self::Os { what: what.into(), cause: cause.to_string() }
    }

    /// Creates the error of a file that cannot be written.
    pub fn write(file: &Path, cause: impl std::fmt::Display) -> Self {
        Self::os(PathBuf::from(file).display().to_string(), cause)
    }

    /// Exit code. It is from sysexits(3) where that has one.
    pub fn exit(&self) -> u8 {
        match self {
            Self::Option { .. } | Self::Share { .. } | Self::Target(_) => 64,
            Self::Config(_) => 78,
            Self::Start(failure) => failure.exit as u8,
            Self::Bus(_) | Self::Client(_) => 69,
            Self::Os { .. } => 71,
            Self::Stuck(_) => 1,
            Self::Interrupted => 130,
        }
    }
}

impl From<teleopd::Failure> for ChaosError {
    fn from(failure: teleopd::Failure) -> Self {
        Self::Start(failure)
    }
}
