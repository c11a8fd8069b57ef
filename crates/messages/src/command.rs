//! Messages of the robot side: targets, commands with their certified stop plan, and the robot's state.

use crate::joints::{JOINTS_MAX, RobotId};
use crate::layout::message;
use crate::skeleton::LIMBS;
use crate::time::{Header, Stamp};

/// Bits of `JointTarget::flags`.
pub mod target_flag {
    /// The input is fresh and has been steady. A person drives every arm whose joints `valid_mask` contains.
    pub const INPUT_FRESH: u32 = 1;
    /// `raw_flag::CLUTCH` of the newest skeleton.
    pub const CLUTCH: u32 = 2;
    /// The closure of the left and the right hand is known.
    pub const CLOSURE: [u32; 2] = [4, 8];
    /// The left, the right hand may touch the robot: the person's is near something.
    pub const TOUCHING: [u32; 2] = [256, 512];
    // Bits 5 to 7 are `PersonChange::FLAGS`.
}

/// Bits of `JointCommand::flags`.
pub mod command_flag {
    /// The command is the next point of the plan before it, not a new decision.
    pub const ON_PLAN: u32 = 1;
    /// Position of the bits of `source_flag`: bits 4 to 7 say who leads each arm.
    pub const SOURCES_SHIFT: u32 = 4;
}

/// Bits of `RobotState::flags`.
pub mod state_flag {
    /// The driver has latched a fault. It executes nothing but the stop plan until a reset edge arrives at rest.
    pub const DRIVER_FAULT: u32 = 1;
    /// The driver has accepted a command since it started.
    pub const COMMANDED: u32 = 2;
    /// The robot's own emergency stop is pressed.
    pub const EMERGENCY_STOP: u32 = 4;
    /// The robot measures its grippers.
    pub const GRIPPERS: u32 = 8;
    /// The robot is unseen: no measurement has come, and the last one is older than `driver.measured_age_max_ms`. Without
    /// real-time scheduling the driver goes on for 190 ms more, and that of a simulated robot for 380 ms.
    pub const UNSEEN: u32 = 16;
}

/// Nodes in the limb trajectory of a target: the person's motion after tick `k`.
pub const TRAJECTORY_NODES: usize = 24;
/// Ticks from one node to the next: 30 ticks are 20 ms. Nodes lie at whole multiples of it.
pub const TRAJECTORY_NODE_TICKS: u64 = 30;
/// Nodes of the trajectory that have hands: 120 ms. Nobody predicts a hand beyond the newest skeleton.
pub const HAND_NODES: usize = 6;

message! {
    /// Posture that the arms should have at tick `k`, and the person's motion after that. Any value is allowed:
    /// `control` makes it safe.
    pub struct JointTarget v 7 size 3192 {
        /// `origin` of the skeleton that the target was made from.
        pub header: Header,
        /// The robot whose joints these are.
        pub robot: RobotId,
        /// Tick index.
        pub k: u64,
        /// Target joint positions, rad or m.
        pub q: [f64; JOINTS_MAX],
        /// Target joint velocities, rad/s or m/s.
        pub dq: [f64; JOINTS_MAX],
        /// The person's limb rotations at the resampled instant, x y z w. Zero for a limb without a person.
        pub human_limbs: [[f64; 4]; LIMBS],
        /// Time at which `ingest` received the newest skeleton that the target uses.
        pub input_received: Stamp,
        /// Sequence of that skeleton.
        pub input_sequence: u64,
        /// Bit j: joint j of `q` and `dq` is valid. A joint without its bit goes to the home posture.
        pub valid_mask: u32,
        /// Bits of `target_flag`.
        pub flags: u32,
        /// Session of that skeleton, mixed with the incarnation of the `ingest` that published it, the person and
        /// the arms in use. If it changes, the robot is released and needs a new enable edge.
        pub session_nonce: u64,
        /// The person's limb rotations at the ticks (trajectory_first + i) * `TRAJECTORY_NODE_TICKS`, x y z w. Zero for a limb
        /// without a person.
        pub limb_trajectory: [[[f32; 4]; LIMBS]; TRAJECTORY_NODES],
        /// Number of the first node of the trajectory: the first one after tick `k`.
        pub trajectory_first: u64,
        /// Number of nodes that were measured. Those after them are predicted.
        pub trajectory_measured: u32,
        /// Number of nodes in the trajectory: zero or `TRAJECTORY_NODES`. If it is zero, `control` follows `q` and `dq`.
        pub trajectory_nodes: u32,
        /// Rotations of the person's left and right hand at the resampled instant, as those of the limbs. Zero for a hand
        /// that is not known.
        pub human_hands: [[f64; 4]; 2],
        /// Rotations that the robot's left and right hand should have at the first nodes of the trajectory. A hand that comes or goes
        /// is blended with a straight one. Zero for a hand that is not known.
        pub hand_trajectory: [[[f32; 4]; 2]; HAND_NODES],
        /// Places that the middle of the robot's left and right hand should have at the nodes of the trajectory, with the wrist at home: x y
        /// z in the torso frame from the origin of the arm's first joint, m, and the weight of this from 0 to 1. Zero for a hand
        /// that touches nothing.
        pub hand_places: [[[f32; 4]; 2]; TRAJECTORY_NODES],
        /// Closure of the person's left and right hand at the resampled instant, from 0 (open) to 1 (closed).
        pub closure: [f32; 2],
    }
}

message! {
    /// Motion of the left and the right gripper, from 0 (open) to 1 (closed). Zero for a hand without a gripper.
    pub struct GripperMotion v 1 size 32 {
        /// Closure.
        pub closure: [f64; 2],
        /// Its rate, 1/s.
        pub rate: [f64; 2],
    }
}

message! {
    /// Measured state of the left and the right gripper. Zero for a hand without a gripper.
    pub struct GripperState v 1 size 48 {
        /// Closure, from 0 (open) to 1 (closed).
        pub closure: [f64; 2],
        /// Force between the fingers, N.
        pub force_n: [f64; 2],
        /// Closure that the robot holds by itself. What is held needs more than the measured one, because the fingers press.
        pub setpoint: [f64; 2],
    }
}

message! {
    /// A stop of all joints. Each joint has three phases of constant jerk, played from the state that the plan
    /// comes with. After the last phase the joint is at rest. The phases of all joints start together: only the
    /// stop as a whole is certified.
    pub struct StopPlan v 2 size 1152 {
        /// Jerk of each phase, rad/s^3 or m/s^3.
        pub jerk: [[f64; 3]; JOINTS_MAX],
        /// Duration of each phase, s.
        pub duration_s: [[f64; 3]; JOINTS_MAX],
    }
}

message! {
    /// The state that the robot should have at tick `k`, and the stop to play if no command for tick `k + 1` arrives.
    pub struct JointCommand v 3 size 1864 {
        /// `origin` of the skeleton that the command follows.
        pub header: Header,
        /// The robot whose joints these are.
        pub robot: RobotId,
        /// Tick index. The command is due at the deadline of `k` plus the configured grace.
        pub k: u64,
        /// Seed of the command's chain: the chain begins after plan tick `seed_played` of command `seed_k`.
        pub seed_k: u64,
        /// See `seed_k`.
        pub seed_played: u64,
        /// Joint positions at tick `k`.
        pub q: [f64; JOINTS_MAX],
        /// Joint velocities at tick `k`.
        pub v: [f64; JOINTS_MAX],
        /// Joint accelerations at tick `k`.
        pub a: [f64; JOINTS_MAX],
        /// The certified stop from (q, v, a).
        pub plan: StopPlan,
        /// Time at which the followed target was published. Zero without a target.
        pub target_stamp: Stamp,
        /// A `Mode`.
        pub mode: u32,
        /// Bits of `command_flag`.
        pub flags: u32,
        /// Number of reset edges. If it changes while the robot is at rest, the driver clears its latched fault.
        pub reset_count: u32,
        /// Zero.
        pub reserved: u32,
        /// The grippers at tick `k`. They are no part of the plan: without a command they brake, and hold what they hold.
        pub grippers: GripperMotion,
    }
}

message! {
    /// The robot's state: what it measures, and what its driver executes.
    pub struct RobotState v 3 size 2304 {
        /// `origin` of the executed command.
        pub header: Header,
        /// The robot whose joints these are.
        pub robot: RobotId,
        /// Tick of the last command that the driver accepted. Before the first one: the tick at which the driver
        /// began to hold.
        pub executed_k: u64,
        /// Plan ticks played since. The executed state below is that of tick `executed_k + plan_ticks_played`.
        pub plan_ticks_played: u64,
        /// Seed of the last accepted command's chain.
        pub seed_k: u64,
        /// See `seed_k`.
        pub seed_played: u64,
        /// Incarnation of the writer of the last accepted command.
        pub command_incarnation: u32,
        /// The last reset edge that the driver saw.
        pub reset_count: u32,
        /// Measured joint positions.
        pub q_measured: [f64; JOINTS_MAX],
        /// Measured joint velocities.
        pub dq_measured: [f64; JOINTS_MAX],
        /// Executed joint positions.
        pub q: [f64; JOINTS_MAX],
        /// Executed joint velocities.
        pub v: [f64; JOINTS_MAX],
        /// Executed joint accelerations.
        pub a: [f64; JOINTS_MAX],
        /// Rest of the stop plan from (q, v, a).
        pub plan: StopPlan,
        /// Number of commands that the driver refused because they did not continue the executed state.
        pub commands_refused: u64,
        /// Bits of `state_flag`.
        pub flags: u32,
        /// Zero.
        pub reserved: u32,
        /// Executed motion of the grippers.
        pub grippers: GripperMotion,
        /// The grippers as measured.
        pub grippers_measured: GripperState,
    }
}
