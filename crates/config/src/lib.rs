//! The settings of an instance, and the files that they name: robot, weights, layouts, operators. Everything is checked
//! before it is used.

mod choice;
mod cores;
mod load;
mod operators;
mod settings;

pub use choice::RobotChoice;
pub use cores::{Chooser, Cores};
pub use driver::Interface;
pub use load::{
    Loaded, Overrides, lacks_weights, load, load_model, load_robot, load_weights, read_settings, read_text,
};
pub use operators::{Operator, Operators};
pub use retarget::{FollowingArms, Method, Settings as RetargetSettings};
pub use safety::engage::Settings as SafetySettings;
pub use settings::{
    ControlSettings, DoorSettings, DriverKind, DriverSettings, EmergencyStopReset, HandOff, IngestSettings,
    MetricsSettings, Policy, RealtimeSettings, Reference, Ros2Settings, Settings, SimSettings,
};

/// Reason for which an instance cannot start. The text names file, key, value and bound.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs, reason = "the texts name the fields")]
pub enum ConfigError {
    #[error("{file}: {cause}")]
    Read { file: String, cause: String },
    #[error("{file}: {cause}")]
    Syntax { file: String, cause: String },
    #[error("{file}: {key} = {} is outside [{low}, {high}]", schema::short(*.value))]
    Bound { file: String, key: String, value: f64, low: f64, high: f64 },
    #[error("{file}: {key} = {} is below {least}, {because}", schema::short(*.value))]
    TooShort { file: String, key: &'static str, value: f64, least: f64, because: &'static str },
    #[error("{cause}")]
    Robot { cause: String },
    #[error(
        "--robot {name}: {folder} has no robot with this name; it has {known}. Run from the repository's root, or give a robot file"
    )]
    UnknownRobot { name: String, folder: String, known: String },
    #[error(transparent)]
    Layout(#[from] layouts::LayoutError),
    #[error("{file}: {key} has {value} entries, at most {most} are allowed")]
    TooMany { file: String, key: &'static str, value: usize, most: usize },
    #[error("{file}: {cause}")]
    Weights { file: String, cause: String },
    #[error("{stage}: {cause}")]
    Stage { stage: &'static str, cause: String },
}

impl ConfigError {
    pub(crate) fn robot(error: robot::RobotError) -> Self {
        Self::Robot { cause: error.to_string() }
    }

    /// Returns the error of a stage that refuses its configuration.
    pub fn stage(stage: &'static str, error: impl std::fmt::Display) -> Self {
        Self::Stage { stage, cause: error.to_string() }
    }
}
