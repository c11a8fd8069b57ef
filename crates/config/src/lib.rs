//! The settings of an instance, and the files that they name: robot, weights, layouts, operators. Everything is checked
//! before it is used.

mod choice;
mod cores;
mod load;
mod operators;
mod settings;

pub use choice::RobotChoice;
pub use cores::Cores;
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
pub enum ConfigError {
    /// A file cannot be read.
    #[error("{file}: {cause}")]
    Read {
        /// The file.
        file: String,
        /// Error of the system, or the bound that was exceeded.
        cause: String,
    },
    /// A file has an unknown, missing or mistyped key.
    #[error("{file}: {cause}")]
    Syntax {
        /// The file.
        file: String,
        /// Line, key and cause.
        cause: String,
    },
    /// A value is outside its bounds.
    #[error("{file}: {key} = {value} is outside [{low}, {high}]")]
    Bound {
        /// The file.
        file: String,
        /// The key.
        key: String,
        /// The value.
        value: f64,
        /// Lowest value allowed.
        low: f64,
        /// Highest value allowed.
        high: f64,
    },
    /// Two values that do not fit together.
    #[error("{file}: {key} = {value} is below {least}, {because}")]
    TooShort {
        /// The file.
        file: String,
        /// The key.
        key: &'static str,
        /// The value.
        value: f64,
        /// Lowest value allowed.
        least: f64,
        /// Reason for the lowest value.
        because: &'static str,
    },
    /// The robot file or URDF is refused.
    #[error("{cause}")]
    Robot {
        /// File, joint, key, value and bound.
        cause: String,
    },
    /// No robot has this name.
    #[error("--robot {name}: {folder} has no robot with this name; it has {known}")]
    UnknownRobot {
        /// The name.
        name: String,
        /// The folder of the robot files.
        folder: String,
        /// Names of the robots in the folder.
        known: String,
    },
    /// A skeleton's layout is refused.
    #[error(transparent)]
    Layout(#[from] layouts::LayoutError),
    /// A list has too many entries.
    #[error("{file}: {key} has {value} entries, at most {most} are allowed")]
    TooMany {
        /// The file.
        file: String,
        /// The key.
        key: &'static str,
        /// Number of entries.
        value: usize,
        /// Largest allowed number.
        most: usize,
    },
    /// The weights are refused.
    #[error("{file}: {cause}")]
    Weights {
        /// The file.
        file: String,
        /// Reason.
        cause: String,
    },
    /// A stage refuses its configuration.
    #[error("{stage}: {cause}")]
    Stage {
        /// The stage.
        stage: &'static str,
        /// Reason.
        cause: String,
    },
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
