//! The doors: Unix SEQPACKET sockets by which processes of other users reach the daemon. They share no memory with it.
//!
//! A `Listener` is the door itself, of `ingest` for skeletons and of `control` for operators: a socket file of mode 0660
//! with a group of its own. connect(2) is the kernel's check: it needs write permission on the file, that is root, the
//! daemon's user, or the file's group among the caller's effective and supplementary groups. The daemon checks the same
//! once more against what the kernel says of the peer (SO_PEERCRED, SO_PEERGROUPS), so that a file whose mode was
//! loosened admits nobody else.
//!
//! Skeletons: the client says in a `Hello` which layout it speaks; `Server` answers with a session number drawn for this
//! connection, or why there is none; then every packet is one `RawSkeleton`. Who of several clients moves the robot
//! is not decided here (`pipeline::Authority`).

mod bucket;
mod client;
mod connection;
mod error;
mod fields;
mod frame;
mod group;
mod listener;
mod nonce;
mod protocol;
mod server;

pub use bucket::{BURST, Bucket, RATE_MAX_HZ};
pub use client::Client;
pub use error::DoorError;
pub use fields::{FieldReader, FieldWriter, Fields};
pub use frame::{FRAME_BYTES, decode_frame, encode_frame};
pub use group::{group_id, user_name};
pub use listener::{Admission, Listener, connect};
pub use nonce::draw_nonce;
pub use protocol::{ANSWER_BYTES, HELLO_BYTES, Hello, Reply, ReplyPacket};
pub use server::{CONNECTIONS_MAX, FrameSource, HELLO_WITHIN_NS, IDLE_NS, LeaseState, Server, SocketEvent};
