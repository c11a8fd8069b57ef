//! Requests of an operator's client over the control socket. The reply is a `Status`.

use crate::layout::message;

/// Version of the socket protocol.
pub const OPERATOR_VERSION: u32 = 4;

/// Value of `OperatorRequest::enable_level` while the enable is held.
pub const HOLDS_ENABLE: u32 = 1;

/// Value of `OperatorRequest::enable_level` while the recovery is held.
pub const HOLDS_RECOVERY: u32 = 2;

/// Bit of `OperatorRequest::enable_level` while the clutch is held, with or without one of the others.
pub const HOLDS_CLUTCH: u32 = 4;

/// Bits of `OperatorRequest::enable_level` beside `HOLDS_ENABLE`: the left and the right arm stay where they are. At most
/// one of them. A change of them while the enable is held is a release.
pub const LEAVES_OUT: [u32; 2] = [8, 16];

/// Bits of `OperatorRequest::enable_level` while the person leads the policy's left, right arm, with or without one of the
/// others.
pub const TAKES_OVER: [u32; 2] = [32, 64];

/// Most edges that one request may count. A larger count comes from a broken counter and not from a person.
pub const EDGES_MAX: u32 = 1000;

/// Bits of `OperatorRequest::payload_flags`.
pub mod payload_flag {
    /// The payload is that of the right hand, else that of the left one.
    pub const RIGHT: u32 = 1;
    /// The request gives the centre of mass, else the robot file's centre is used.
    pub const CENTRE: u32 = 2;
    /// Every bit.
    pub const ALL: u32 = RIGHT | CENTRE;
}

message! {
    /// One heartbeat of an operator's client. The counters count edges since the client connected, so a lost or
    /// repeated datagram loses or doubles no edge. The level is what the operator holds now.
    pub struct OperatorRequest v 3 size 72 {
        /// `OPERATOR_VERSION`.
        pub version: u32,
        /// State of the operator's hold: `HOLDS_ENABLE`, `HOLDS_RECOVERY`, or 0 for nothing. `HOLDS_CLUTCH`,
        /// one of `LEAVES_OUT` and those of `TAKES_OVER` are added to it.
        pub enable_level: u32,
        /// Press edges of the enable or the recovery.
        pub enable_count: u32,
        /// Release edges.
        pub release_count: u32,
        /// Reset edges.
        pub reset_count: u32,
        /// Emergency stop edges, accepted from any connection.
        pub estop_count: u32,
        /// Payload edges: how often the operator set a payload. The newest payload is below.
        pub payload_count: u32,
        /// Bits of `payload_flag`.
        pub payload_flags: u32,
        /// Number of heartbeats sent.
        pub sequence: u64,
        /// Mass of the payload, kg.
        pub payload_kg: f64,
        /// Centre of mass in the hand's frame, m. Used only with `payload_flag::CENTRE`.
        pub payload_centre_m: [f64; 3],
    }
}
