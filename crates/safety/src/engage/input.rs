//! What the state machine sees and says.

use messages::{FAULTS, Faults, Mode, PayloadOrder, Stamp, Transition};

/// The operator, as the control socket sees him at this tick. Edges are counters' increments since the last tick.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct OperatorView {
    /// The client that holds, or asks for, authority is connected.
    pub connected: bool,
    /// The enable is held.
    pub enable_level: bool,
    /// The enable was pressed since the last tick.
    pub enable_edge: bool,
    /// The recovery is held; never together with the enable.
    pub recover_level: bool,
    /// The recovery was pressed since the last tick.
    pub recover_edge: bool,
    /// A release was asked for since the last tick.
    pub release_edge: bool,
    /// A reset was asked for since the last tick.
    pub reset_edge: bool,
    /// An emergency stop was asked for since the last tick, by any connection.
    pub estop_edge: bool,
    /// When the last heartbeat arrived, by the own clock; zero for never.
    pub heartbeat_received: Stamp,
    /// What was said since the last tick of the left and the right hand. The state machine does not look at it.
    pub payload: [Option<PayloadOrder>; 2],
}

/// The stream of targets.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TargetView {
    /// When the newest target arrived, by the own clock; zero for never.
    pub received: Stamp,
    /// Incarnation of its writer.
    pub incarnation: u32,
    /// Session of the client behind it; zero while there is none.
    pub session_nonce: u64,
    /// Its writer runs with the same configuration.
    pub config_matches: bool,
    /// `target_flag::INPUT_FRESH`.
    pub input_fresh: bool,
    /// When `ingest` received the newest skeleton behind it; zero for never.
    pub input_received: Stamp,
    /// It carries values that no network may produce.
    pub implausible: bool,
    /// It is new, and farther from the one before than anybody moves.
    pub jumped: bool,
}

/// The robot, as its driver tells and as the monitors judge it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RobotView {
    /// When the newest state arrived, by the own clock; zero for never.
    pub received: Stamp,
    /// Incarnation of the driver.
    pub incarnation: u32,
    /// The driver runs with the same configuration.
    pub config_matches: bool,
    /// The driver has taken up the command stream.
    pub commanded: bool,
    /// `state_flag::DRIVER_FAULT`.
    pub driver_fault: bool,
    /// `state_flag::EMERGENCY_STOP`: pressed at the robot.
    pub emergency_stop: bool,
    /// What is measured cannot be.
    pub feedback_invalid: bool,
    /// The last reset edge that the driver saw.
    pub reset_count: u32,
    /// A measured joint is outside its limits.
    pub outside_limits: bool,
    /// The posture is closer to self-collision than allowed for engaging.
    pub in_collision: bool,
    /// Neither of the two holds, and the commanded posture keeps the limits and the clearance that a recovery aims for
    /// (see `monitor::clear_to_start`).
    pub clear_to_start: bool,
    /// The measured posture is closer to self-collision than allowed in motion (see `monitor::Near`).
    pub collision_near: bool,
    /// By how much the newest state is newer than the one that was judged before, ns; zero if it is that one.
    pub sample_ns: u64,
    /// Largest |command - measured| of the revolute joints, rad.
    pub tracking_error_rad: f64,
    /// Largest |command - measured| of the prismatic joints, m.
    pub tracking_error_m: f64,
    /// A joint is measured too fast, or moving otherwise than it is sent (see `monitor::Movement`).
    pub velocity_error: bool,
    /// The robot left the place where it came to rest, or does not come to rest (see `monitor::Movement`).
    pub standstill_lost: bool,
    /// The measured robot is at rest, and near where its command rests.
    pub at_rest: bool,
}

/// What whole-body control and the gate reported at the tick before.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MotionView {
    /// Every commanded joint is at rest.
    pub at_rest: bool,
    /// Every valid joint of the command is near its target.
    pub aligned: bool,
    /// The command is far from its target.
    pub behind: bool,
    /// The command moves no more (it may be blocked on its way to the target).
    pub settled: bool,
    /// The gate denied the command.
    pub gate_denied: bool,
}

impl Input {
    /// Whether the robot is at rest: the command is, and what is measured is too.
    pub(super) const fn at_rest(&self) -> bool {
        self.motion.at_rest && self.robot.at_rest
    }
}

/// All that the state machine judges at tick `k`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Input {
    /// Tick index.
    pub k: u64,
    /// Time since the own previous tick, ns. What goes beyond a tick's length is never charged to a writer.
    pub own_gap_ns: u64,
    /// Deadlines that the own process missed in a row.
    pub deadlines_missed: u32,
    /// Scheduling is real-time, or the configuration allows to engage without.
    pub realtime_ok: bool,
    /// See `OperatorView`.
    pub operator: OperatorView,
    /// See `TargetView`.
    pub target: TargetView,
    /// See `RobotView`.
    pub robot: RobotView,
    /// See `MotionView`.
    pub motion: MotionView,
}

/// What the robot may do at this tick.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Permit {
    /// Follow the target with at most `speed_scale` (0 to 1) of each joint's velocity limit.
    Follow {
        /// Share of the velocity limit.
        speed_scale: f64,
    },
    /// Back inside the limits and away from the robot's own body, slowly, and nothing else.
    Recover,
    /// Play the stored stop plan, and rest at its end.
    Stop,
}

impl Permit {
    /// Share of the velocity limit of a motion that follows; zero for all others.
    pub const fn speed_scale(self) -> f64 {
        match self {
            Self::Follow { speed_scale } => speed_scale,
            Self::Recover | Self::Stop => 0.0,
        }
    }
}

/// What the state machine decided at this tick. Always complete.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Output {
    /// Mode from this tick on.
    pub mode: Mode,
    /// What the robot may do.
    pub permit: Permit,
    /// Why the speed is reduced, as bits of `reduced_flag`; zero while nothing is followed.
    pub reduced: u32,
    /// Faults that hold at this tick, debounced.
    pub active: Faults,
    /// Faults that wait for a reset.
    pub latched: Faults,
    /// The transition of this tick.
    pub transition: Option<Transition>,
    /// An enable or recovery edge was refused at this tick; `active` says why, or nothing was ever seen released.
    pub refused: bool,
    /// The command and the measured robot are at rest.
    pub at_rest: bool,
    /// Counts accepted resets, from what the driver last saw; goes into every command.
    pub reset_count: u32,
    /// How often each fault was raised since start, indexed by `Fault`.
    pub fault_counts: [u32; FAULTS.len()],
}
