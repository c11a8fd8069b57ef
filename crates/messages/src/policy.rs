//! Messages of a policy, and of programs that watch the joints: chunks of joint targets in, the joints out.

use crate::joints::{JOINTS_MAX, RobotId};
use crate::layout::message;
use crate::time::{Header, Stamp};

/// The most rows of one chunk. Published action chunks have 8 to 100 rows.
pub const CHUNK_ROWS_MAX: usize = 100;

/// Bits of `PolicyChunk::flags`.
pub mod chunk_flag {
    /// `v` is filled. Without it, the velocities are those of a curve through the rows.
    pub const VELOCITIES: u32 = 1;
    /// The closure of the left, the right gripper is filled. Without it, the gripper holds what it holds.
    pub const CLOSURE: [u32; 2] = [2, 4];
}

/// Bits that say who leads an arm, in `Status::sources` and `Joints::sources`.
pub mod source_flag {
    /// A person leads the left, the right arm.
    pub const PERSON: [u32; 2] = [1, 2];
    /// A policy leads the left, the right arm.
    pub const POLICY: [u32; 2] = [4, 8];

    /// Names the leader of the left (0) or right (1) arm.
    pub fn leader(sources: u32, side: usize) -> Option<&'static str> {
        let all = [(PERSON[side], "person"), (POLICY[side], "policy")];
        all.into_iter().find(|(bit, _)| sources & bit != 0).map(|(_, name)| name)
    }
}

message! {
    /// Joint targets of a policy: row i is due at `start` + i * `period_ns`. A newer chunk replaces an older one from its
    /// own start on.
    pub struct PolicyChunk v 1 size 20104 {
        /// `origin` is the time at which the robot was observed. The rows rest on that observation.
        pub header: Header,
        /// Random number that the program draws at its start.
        pub session_nonce: u64,
        /// The robot whose joints these are, as `Joints::robot` names it.
        pub robot: RobotId,
        /// Time at which `ingest` received the chunk. A client leaves it zero.
        pub received: Stamp,
        /// Time of the first row.
        pub start: Stamp,
        /// Time from one row to the next, ns.
        pub period_ns: u64,
        /// Number of rows that are filled.
        pub rows: u32,
        /// Bit j: joint j of the rows is valid. A joint without its bit stays where it is.
        pub valid_mask: u32,
        /// Bits of `chunk_flag`.
        pub flags: u32,
        /// Zero.
        pub reserved: u32,
        /// Joint positions, rad or m.
        pub q: [[f32; JOINTS_MAX]; CHUNK_ROWS_MAX],
        /// Joint velocities, rad/s or m/s.
        pub v: [[f32; JOINTS_MAX]; CHUNK_ROWS_MAX],
        /// Closures of the left and the right gripper, from 0 (open) to 1 (closed).
        pub closure: [[f32; 2]; CHUNK_ROWS_MAX],
    }
}

crate::named! {
    /// Reason for which `ingest` drops a chunk.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    #[repr(u32)]
    pub enum ChunkDrop {
        Robot = 0 => "other_robot": "it is for another robot; copy `robot` from the newest `Joints`",
        Shape = 1 => "shape": "1 to 100 rows, 5 to 1000 ms apart, of at least one joint of the robot are allowed",
        Value = 2 => "value": "a value is not finite, a position or velocity is beyond 10 turns, or a closure is not from 0 to 1; send radians and metres",
        Order = 3 => "order": "sequence and stamp must grow within a session; count on, or begin a new session",
        Old = 4 => "old": "its last row is over, or comes more than 10 s after its observation; send shorter chunks sooner",
        Future = 5 => "future": "its start is more than 1 s ahead, or its observation more than 2 ms; stamp with CLOCK_MONOTONIC in ns",
        Lease = 6 => "lease": "another policy holds the lease, or held it when this session began; begin a new session after it",
        Quota = 7 => "quota": "its publisher sends more than 250 chunks a second; send fewer",
    }
}

/// Bits of `Joints::known`.
pub mod joints_flag {
    /// The driver publishes a state: `commanded` and `measured` mean something.
    pub const STATE: u32 = 1;
    /// `control` publishes its status: mode and sources mean something.
    pub const STATUS: u32 = 2;
    /// A policy holds its lease: `short_of` means something.
    pub const POLICY: u32 = 4;
}

message! {
    /// The joints of the robot, 100 times a second, for policies and for programs that watch.
    pub struct Joints v 2 size 1104 {
        /// `stamp` says how old it is. `origin` is that of the executed command.
        pub header: Header,
        /// The robot whose joints these are.
        pub robot: RobotId,
        /// Index of the executed command.
        pub k: u64,
        /// A `Mode`.
        pub mode: u32,
        /// Bits of `source_flag`.
        pub sources: u32,
        /// Bits of `joints_flag`.
        pub known: u32,
        /// Reason plus one for which the newest chunk was dropped, if that was within the last second: a `ChunkDrop`.
        pub chunk_dropped_why: u32,
        /// Chunks that were dropped since start, indexed by `ChunkDrop`.
        pub chunks_dropped: [u64; 8],
        /// Executed joint positions, rad or m.
        pub commanded: [f64; JOINTS_MAX],
        /// Executed joint velocities, rad/s or m/s.
        pub commanded_v: [f64; JOINTS_MAX],
        /// Measured joint positions, rad or m.
        pub measured: [f64; JOINTS_MAX],
        /// Measured joint velocities, rad/s or m/s.
        pub measured_v: [f64; JOINTS_MAX],
        /// Position that the policy asks for less the executed one, rad or m: what limits and certificate took away, and the
        /// lag of the arm. Zero for a joint without a policy.
        pub short_of: [f64; JOINTS_MAX],
    }
}
