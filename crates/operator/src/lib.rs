//! What an operator commands, and the socket over which it arrives.
//!
//! A Unix SEQPACKET socket of `control`, because the bus has only so many slots and a stopped client could hold one. Every
//! client sends an `OperatorRequest` (its heartbeat) and gets a `Status` back. Requests carry counters, so that an edge is
//! neither lost nor doubled, and a level.
//!
//! - The enable, or in its place the recovery, belongs to one connection, the first whose enable edge arrives while nobody holds it. It loses it by a
//!   release, by lowering its level, by going away, or by a heartbeat that is late by the lease; to get it back takes a
//!   new edge.
//! - Release and emergency stop are accepted from every connection. So is a reset, unless the settings leave it to the user who
//!   pressed the emergency stop (`ResetRule`).
//! - When all places are taken, the process with the most places loses its idlest one. Every process has one place before any
//!   has a second. An emergency stop is heard from a connection that gets no place, too.
//!
//! The socket is a door (`doors::Listener`): mode 0660 and a group of its own.

mod client;
mod codec;
mod error;
mod locks;
mod merge;
mod server;

pub use client::{Client, reset_refusal};
pub use codec::{REQUEST_BYTES, STATUS_BYTES, decode_request, decode_status, encode_request, encode_status};
pub use error::OperatorError;
pub use locks::ResetRule;
pub use merge::{CLIENTS_MAX, LEASE_NS, OperatorView};
pub use server::{AuditEvent, AuditRecord, Server};
