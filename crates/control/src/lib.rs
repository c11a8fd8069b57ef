//! The control tick. Engagement decides which motion is allowed, whole-body control proposes a command, and the
//! gate accepts or denies it. Never does IO, never reads a clock, never allocates in a tick.

#![forbid(clippy::disallowed_macros, clippy::disallowed_methods, clippy::disallowed_types)]

mod chain;
mod commander;
mod feedback;
mod following;
mod gripping;
mod leaders;
mod limited;
mod one_arm;
mod payload;
mod report;
mod robot_state;
mod status;
mod target;
mod tick;

pub use chain::{Continue, Stream};
pub use commander::{Commanded, Commander};
pub use feedback::feedback;
pub use status::STATUS_EVERY;
pub use tick::{State, tick};

use messages::{InputStatus, JointCommand, JointTarget, RobotState, Status};
use retarget::ArmModel;
use robot::Model;
use safety::engage::{self, OperatorView};
use safety::{gate, gripper};

/// Configuration of the control tick, made of the configurations of its stages. Each of them is valid.
#[derive(Clone, Debug)]
pub struct Config {
    /// The robot.
    pub model: Model,
    /// Engagement.
    pub engage: engage::Config,
    /// Whole-body control.
    pub wbc: wbc::Config,
    /// The gate.
    pub gate: gate::Config,
    /// Following.
    pub follow: follow::Config,
    /// The grippers, and the limits that their gate enforces.
    pub grippers: driver::Grippers,
    /// See `grippers`.
    pub gripper_gate: gripper::Config,
    /// A Disengaged robot opens its grippers. Otherwise they hold what they hold.
    pub open_grippers_when_disengaged: bool,
    /// Kinematics of the limbs.
    pub arms: [ArmModel; 2],
    /// Known delay from a setpoint to its measurement, s. The command's lead over that delay is no tracking error.
    pub servo_lag_s: f64,
    /// Tracking errors that stop, rad and m. The status names the joint with the largest share of them.
    pub tracking_max: [f64; 2],
    /// Hash of the instance's files, which every message carries.
    pub config_hash: u64,
    /// True if scheduling is real-time.
    pub realtime: bool,
}

/// Input of a tick: only what is new since the last one.
#[derive(Clone, Copy, Debug)]
pub struct Input<'a> {
    /// Tick index. Each index has one tick, and the index never goes back.
    pub k: u64,
    /// A new target of the person.
    pub target: Option<&'a JointTarget>,
    /// A new target of a policy.
    pub policy: Option<&'a JointTarget>,
    /// A new robot state.
    pub robot: Option<&'a RobotState>,
    /// The operators, with the edges since the last tick.
    pub operator: OperatorView,
    /// Status of `ingest`. It is shown and influences no decision.
    pub ingest: Option<&'a InputStatus>,
    /// Scheduling is real-time, or the settings allow a simulated robot to engage without it.
    pub realtime_ok: bool,
}

/// Result of a tick.
#[derive(Clone, Copy, Debug)]
pub struct Output {
    /// Command to publish. `None` while there is no driver state to continue from.
    pub command: Option<JointCommand>,
    /// Status to publish, at 50 Hz.
    pub status: Status,
    /// Transition of this tick, if there was one.
    pub transition: Option<messages::Transition>,
}
