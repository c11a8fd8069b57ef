//! What an operator's client sends over the control socket, and nothing else: the reply is a `Status`.

use crate::layout::message;

/// Version of the socket protocol.
pub const OPERATOR_VERSION: u32 = 3;

/// `OperatorRequest::enable_level` while the enable is held.
pub const HOLDS_ENABLE: u32 = 1;

/// `OperatorRequest::enable_level` while the recovery is held.
pub const HOLDS_RECOVERY: u32 = 2;

/// Bits of `OperatorRequest::payload_flags`.
pub mod payload_flag {
    /// The right hand is meant; else the left one.
    pub const RIGHT: u32 = 1;
    /// The centre is said; else that of the robot file counts.
    pub const CENTRE: u32 = 2;
    /// Every bit.
    pub const ALL: u32 = RIGHT | CENTRE;
}

message! {
    /// One heartbeat of an operator's client. The counters count edges since the client connected, so that none is
    /// lost or doubled when a datagram is; the level is what the operator holds now.
    pub struct OperatorRequest v 3 size 72 {
        /// `OPERATOR_VERSION`.
        pub version: u32,
        /// What the operator holds: `HOLDS_ENABLE`, `HOLDS_RECOVERY`, or 0 for nothing.
        pub enable_level: u32,
        /// Edges of what is held.
        pub enable_count: u32,
        /// Release edges.
        pub release_count: u32,
        /// Reset edges.
        pub reset_count: u32,
        /// Emergency stop edges, accepted from any connection.
        pub estop_count: u32,
        /// Payload edges: how often the operator said what a hand carries. The newest is below.
        pub payload_count: u32,
        /// Bits of `payload_flag`.
        pub payload_flags: u32,
        /// Heartbeats sent.
        pub sequence: u64,
        /// What the hand carries, kg.
        pub payload_kg: f64,
        /// Centre of mass in the hand's frame, m; counts with `payload_flag::CENTRE`.
        pub payload_centre_m: [f64; 3],
    }
}
