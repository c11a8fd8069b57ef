//! Inputs and outputs of the state machine.

use messages::{FAULTS, Faults, Mode, PayloadOrder, Permit, Stamp, Transition};

/// The operator, as the control socket reports at this tick. An edge is an increment of a counter since the last tick.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct OperatorView {
    /// The client that holds or requests authority is connected.
    pub connected: bool,
    /// The enable is held.
    pub enable_level: bool,
    /// The enable was pressed since the last tick.
    pub enable_edge: bool,
    /// The recovery is held. It is never held together with the enable.
    pub recover_level: bool,
    /// The recovery was pressed since the last tick.
    pub recover_edge: bool,
    /// The left and the right arm stay where they are while the enable is held. The state machine does not use them.
    pub left_out: [bool; 2],
    /// The person leads the policy's left and right arm. The state machine does not use them.
    pub takes_over: [bool; 2],
    /// The clutch is held, by any connection.
    pub clutch_level: bool,
    /// The operator requested a release since the last tick.
    pub release_edge: bool,
    /// The operator requested a reset since the last tick.
    pub reset_edge: bool,
    /// Any connection requested an emergency stop since the last tick.
    pub estop_edge: bool,
    /// Arrival time of the last heartbeat, by this machine's clock. Zero before the first.
    pub heartbeat_received: Stamp,
    /// Payload orders for the left and the right hand since the last tick. The state machine does not use them.
    pub payload: [Option<PayloadOrder>; 2],
}

/// The stream of targets.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TargetView {
    /// Arrival time of the newest target, by this machine's clock. Zero before the first.
    pub received: Stamp,
    /// Incarnation of its writer.
    pub incarnation: u32,
    /// Session of the client behind it. Zero if there is none.
    pub session_nonce: u64,
    /// Its writer runs with the same configuration as this process.
    pub config_matches: bool,
    /// `target_flag::INPUT_FRESH`.
    pub input_fresh: bool,
    /// Time at which `ingest` received the newest skeleton behind it. Zero before the first.
    pub input_received: Stamp,
    /// `target_flag::CLUTCH`.
    pub clutch: bool,
    /// It carries values that the network must not produce.
    pub implausible: bool,
    /// It is new, and farther from the previous one than any person moves.
    pub jumped: bool,
}

/// The robot, as its driver reports it and as the monitors judge it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RobotView {
    /// Arrival time of the newest state, by this machine's clock. Zero before the first.
    pub received: Stamp,
    /// Incarnation of the driver.
    pub incarnation: u32,
    /// The driver runs with the same configuration as this process.
    pub config_matches: bool,
    /// The driver follows the command stream.
    pub commanded: bool,
    /// `state_flag::DRIVER_FAULT`.
    pub driver_fault: bool,
    /// `state_flag::EMERGENCY_STOP`: the emergency stop at the robot is pressed.
    pub emergency_stop: bool,
    /// The measurements are implausible.
    pub feedback_invalid: bool,
    /// The last reset edge that the driver saw.
    pub reset_count: u32,
    /// A measured joint is outside its limits.
    pub outside_limits: bool,
    /// The posture is closer to self-collision or to an obstacle than allowed for engaging.
    pub in_collision: bool,
    /// Neither of these two flags is set, and the commanded posture keeps the limits and the clearance that a
    /// recovery aims for (see `monitor::clear_to_start`).
    pub clear_to_start: bool,
    /// The measured posture is closer to self-collision or to an obstacle than allowed in motion (see `monitor::Near`).
    pub collision_near: bool,
    /// Time by which the newest state is newer than the one judged before, ns. Zero if it is the same one.
    pub sample_ns: u64,
    /// Largest |command - measured| of the revolute joints, rad.
    pub tracking_error_rad: f64,
    /// Largest |command - measured| of the prismatic joints, m.
    pub tracking_error_m: f64,
    /// A joint is measured too fast, or it moves otherwise than commanded (see `monitor::Movement`).
    pub velocity_error: bool,
    /// The robot left the place where it came to rest, or does not come to rest (see `monitor::Movement`).
    pub standstill_lost: bool,
    /// The measured robot is at rest, near the position where its command rests.
    pub at_rest: bool,
}

/// Reports of whole-body control and of the gate at the previous tick.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MotionView {
    /// Every commanded joint is at rest.
    pub at_rest: bool,
    /// Every valid joint of the command is near its target.
    pub aligned: bool,
    /// The command is far from its target.
    pub behind: bool,
    /// The command no longer moves. It may be blocked on its way to the target.
    pub settled: bool,
    /// The gate denied the command.
    pub gate_denied: bool,
}

impl Input {
    /// Returns true if the robot is at rest, both by its command and by its measurements.
    pub(super) const fn at_rest(&self) -> bool {
        self.motion.at_rest && self.robot.at_rest
    }
}

/// Everything that the state machine judges at tick `k`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Input {
    /// Tick index.
    pub k: u64,
    /// Time since the previous tick of this process, ns. The part beyond the charged maximum of two ticks is
    /// never charged to a writer.
    pub own_gap_ns: u64,
    /// Number of deadlines that this process missed in a row.
    pub deadlines_missed: u32,
    /// Scheduling is real-time, or the configuration allows engaging without it.
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

/// Decision of the state machine at this tick. Every field is always set.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Output {
    /// Mode from this tick on.
    pub mode: Mode,
    /// Permission for the robot.
    pub permit: Permit,
    /// Reasons for a reduced speed, as bits of `reduced_flag`. Zero while the robot follows nothing.
    pub reduced: u32,
    /// Faults that hold at this tick, debounced.
    pub active: Faults,
    /// Faults that wait for a reset.
    pub latched: Faults,
    /// The transition of this tick.
    pub transition: Option<Transition>,
    /// An enable or recovery edge was refused at this tick. `active` holds the cause. If it has none, the
    /// enable was never seen released.
    pub refused: bool,
    /// The command and the measured robot are at rest.
    pub at_rest: bool,
    /// Counts accepted resets, starting from the count that the driver last saw. Every command carries it.
    pub reset_count: u32,
    /// Number of times that each fault was raised since start, indexed by `Fault`.
    pub fault_counts: [u32; FAULTS.len()],
}
