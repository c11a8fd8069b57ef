//! What an operator's client sends over the control socket, and nothing else: the reply is a `Status`.

use crate::layout::message;

/// Version of the socket protocol.
pub const OPERATOR_VERSION: u32 = 2;

/// `OperatorRequest::enable_level` while the enable is held.
pub const HOLDS_ENABLE: u32 = 1;

/// `OperatorRequest::enable_level` while the recovery is held.
pub const HOLDS_RECOVERY: u32 = 2;

message! {
    /// One heartbeat of an operator's client. The counters count edges since the client connected, so that none is
    /// lost or doubled when a datagram is; the level is what the operator holds now.
    pub struct OperatorRequest v 2 size 32 {
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
        /// Heartbeats sent.
        pub sequence: u64,
    }
}
