//! Unix SEQPACKET sockets by which processes of other users reach the daemon. They share no memory with it.
//!
//! A `Listener` is such a socket file, of mode 0660 and with a group of its own. `ingest` has one for skeletons,
//! `control` one for operators. First, connect(2) makes the kernel's check: it needs write permission on the
//! file. Root and the daemon's user have it, and every caller with the file's group among its effective and
//! supplementary groups. Then the daemon checks the same once more, with the kernel's data on the peer
//! (SO_PEERCRED, SO_PEERGROUPS). So a file whose mode was loosened admits no other user.
//!
//! A skeleton client first sends a `Hello` with its layout. `Server` replies with a session number drawn for this
//! connection, or with the reason for a refusal. Then every packet is one `RawSkeleton`. A policy's first packet is
//! `POLICY_HELLO`. Then every packet is one chunk as JSON, and the joints come back as JSON. This crate does not
//! decide which of several clients moves the robot. `ingest::Authority` does.

mod client;
mod connection;
mod error;
mod frame;
mod group;
mod listener;
mod nonce;
mod policy;
mod protocol;
mod server;

pub use client::Client;
pub use error::{DoorError, LINK_FILE, hint, linked_or, linked_robot};
pub use frame::{FRAME_BYTES, decode_frame, encode_frame};
pub use group::{group_id, user_name};
pub use listener::{Admission, Listener, connect};
pub use messages::{BURST, Bucket, RATE_MAX_HZ};
pub use nonce::draw_nonce;
pub use policy::{NoChunk, POLICY_BYTES_MAX, POLICY_HELLO, chunk_from_json, drop_as_json};
pub use protocol::{ANSWER_BYTES, HELLO_BYTES, Hello, REQUESTS_FEEDBACK, Reply, ReplyPacket};
pub use server::{CONNECTIONS_MAX, FrameSource, HELLO_WITHIN_NS, IDLE_NS, LeaseState, Server, SocketEvent};
