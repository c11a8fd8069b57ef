//! A client of the daemon: it plays a motion, and publishes the frames through the input domain or the skeleton socket,
//! like any other client.

mod player;
mod publisher;

pub use player::{PlayOptions, Player};
pub use publisher::{ClientError, Port, Publisher, Transport};
