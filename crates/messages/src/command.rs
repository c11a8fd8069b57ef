//! The robot side of the bus: targets, commands with their certified stop plan, and the robot's state.

use crate::joints::JOINTS;
use crate::layout::message;
use crate::skeleton::LIMBS;
use crate::time::{Header, Stamp};

/// Bits of `JointTarget::flags`.
pub mod target_flag {
    /// The input is fresh and has been steady: a human stands behind every arm of this target that is meant.
    pub const INPUT_FRESH: u32 = 1;
    // Bits 5 to 7 are `PersonChange::FLAGS`.
}

/// Bits of `JointCommand::flags`.
pub mod command_flag {
    /// The command is the next point of the plan before it, not a new decision.
    pub const ON_PLAN: u32 = 1;
}

/// Bits of `RobotState::flags`.
pub mod state_flag {
    /// The driver has latched a fault: it executes nothing but the plan until a reset edge at rest.
    pub const DRIVER_FAULT: u32 = 1;
    /// The driver has accepted a command since it started.
    pub const COMMANDED: u32 = 2;
    /// The robot's own emergency stop is pressed.
    pub const EMERGENCY_STOP: u32 = 4;
}

/// Nodes of a person's way in a target.
pub const WAY_NODES: usize = 24;
/// Ticks from one node to the next: 20 ms. Nodes stand at whole multiples of it.
pub const WAY_NODE_TICKS: u64 = 30;

message! {
    /// Where the arms should be at tick `k` and how the person goes on from there: any value is allowed, `control` makes it
    /// safe.
    pub struct JointTarget v 2 size 2032 {
        /// `origin` of the skeleton behind it.
        pub header: Header,
        /// Tick index.
        pub k: u64,
        /// Target joint positions, rad or m.
        pub q: [f64; JOINTS],
        /// Target joint velocities, rad/s or m/s.
        pub dq: [f64; JOINTS],
        /// The human's limb rotations at the resampled instant, x y z w; zero where there is none.
        pub human_limbs: [[f64; 4]; LIMBS],
        /// When the newest skeleton behind it was received by `ingest`.
        pub input_received: Stamp,
        /// Sequence of that skeleton.
        pub input_sequence: u64,
        /// Bit j: joint j of `q` and `dq` is meant; what is not valid goes to the home posture.
        pub valid_mask: u32,
        /// Bits of `target_flag`.
        pub flags: u32,
        /// Session of that skeleton, mixed with the incarnation of the `ingest` that passed it: another one is another
        /// authority.
        pub session_nonce: u64,
        /// The person's limb rotations at the ticks (way_first + i) * `WAY_NODE_TICKS`, x y z w; zero where there is none.
        pub way: [[[f32; 4]; LIMBS]; WAY_NODES],
        /// The first node of the way: the first one after tick `k`.
        pub way_first: u64,
        /// So many nodes were seen; those after them are predicted.
        pub way_seen: u32,
        /// Nodes of the way: zero or `WAY_NODES`. Without a way the joints are followed.
        pub way_nodes: u32,
    }
}

message! {
    /// A stop of all joints: for each joint three phases of constant jerk, played from the state that it travels with.
    /// After the last phase the joint is at rest. The phases of all joints start together: a stop is certified only
    /// as a whole.
    pub struct StopPlan v 1 size 816 {
        /// Jerk of each phase, rad/s^3 or m/s^3.
        pub jerk: [[f64; 3]; JOINTS],
        /// Duration of each phase, s.
        pub duration_s: [[f64; 3]; JOINTS],
    }
}

message! {
    /// The state to be in at tick `k`, and the stop to play if no command for tick `k + 1` arrives.
    pub struct JointCommand v 1 size 1312 {
        /// `origin` of the skeleton behind it.
        pub header: Header,
        /// Tick index: the command is due at the deadline of `k` plus the grace of the config.
        pub k: u64,
        /// The chain this command belongs to begins after plan tick `seed_played` of command `seed_k`.
        pub seed_k: u64,
        /// See `seed_k`.
        pub seed_played: u64,
        /// Joint positions at tick `k`.
        pub q: [f64; JOINTS],
        /// Joint velocities at tick `k`.
        pub v: [f64; JOINTS],
        /// Joint accelerations at tick `k`.
        pub a: [f64; JOINTS],
        /// The certified stop from (q, v, a).
        pub plan: StopPlan,
        /// When the target behind it was published; zero without one.
        pub target_stamp: Stamp,
        /// A `Mode`.
        pub mode: u32,
        /// Bits of `command_flag`.
        pub flags: u32,
        /// Counts reset edges: a change clears the driver's latched fault at rest.
        pub reset_count: u32,
        /// Zero.
        pub reserved: u32,
    }
}

message! {
    /// What the robot does: measured, and what its driver executes.
    pub struct RobotState v 1 size 1592 {
        /// `origin` of the executed command.
        pub header: Header,
        /// Tick of the last command that the driver accepted (at its start: the tick it began to hold).
        pub executed_k: u64,
        /// Plan ticks played since: the executed state below is that of tick `executed_k + plan_ticks_played`.
        pub plan_ticks_played: u64,
        /// Chain of the last accepted command.
        pub seed_k: u64,
        /// Chain of the last accepted command.
        pub seed_played: u64,
        /// Incarnation of the writer of the last accepted command.
        pub command_incarnation: u32,
        /// The last reset edge that the driver saw.
        pub reset_count: u32,
        /// Measured joint positions.
        pub q_measured: [f64; JOINTS],
        /// Measured joint velocities.
        pub dq_measured: [f64; JOINTS],
        /// Executed joint positions.
        pub q: [f64; JOINTS],
        /// Executed joint velocities.
        pub v: [f64; JOINTS],
        /// Executed joint accelerations.
        pub a: [f64; JOINTS],
        /// What is left of the stop plan from (q, v, a).
        pub plan: StopPlan,
        /// Commands that were refused because they did not continue from the executed state.
        pub commands_refused: u64,
        /// Bits of `state_flag`.
        pub flags: u32,
        /// Zero.
        pub reserved: u32,
    }
}
