//! The commands of the operators, and the socket over which they arrive.
//!
//! It is a Unix SEQPACKET socket of `control`, because the bus has few slots and a stopped client could occupy
//! one. Every client sends an `OperatorRequest` (its heartbeat) and gets a `Status` back. Requests carry a level,
//! and counters, so that an edge is neither lost nor doubled.
//!
//! - One connection holds the enable, or in its place the recovery: the first whose enable edge arrives while no
//!   other holds it. It loses it by a release, by lowering its level, by disconnecting, or by a heartbeat that is
//!   late by the lease. To get it back it needs a new edge.
//! - Every connection may release and press the emergency stop. Every connection may reset too, unless the
//!   settings leave the reset to the user who pressed the emergency stop (`ResetRule`).
//! - When all connections are in use, the process with the most connections loses its idlest one. Every process
//!   has one connection before any has a second. A client without a connection can still press the emergency stop.
//!
//! The socket is a `doors::Listener`: mode 0660 and a group of its own.

mod client;
mod codec;
mod edges;
mod error;
mod locks;
mod merge;
mod press;
mod server;
mod session;

pub use client::{Client, reset_refusal};
pub use codec::{REQUEST_BYTES, STATUS_BYTES, decode_request, decode_status, encode_request, encode_status};
pub use doors::linked_robot;
pub use edges::OperatorEdges;
pub use error::OperatorError;
pub use locks::ResetRule;
pub use merge::{CLIENTS_MAX, Connection, LEASE_NS, Merge, OperatorCounts};
pub use press::StopPress;
pub use safety::engage::OperatorView;
pub use server::{AuditEvent, AuditRecord, Server};
pub use session::OperatorSession;
