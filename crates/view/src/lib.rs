//! Shows a running instance in a browser, and passes on what an operator asks for there.
//!
//! One thread reads the instance's messages 60 times a second, without waking anyone; a thread for every open page sends
//! what is new. A page can only ask: its requests go through the operator socket like those of `teleopctl`, and `control`
//! decides. Where there are key poses, a page can also be a client, whose person is a mix of them, by the skeleton socket.
//! The server listens on the loopback alone; who asks must come from its own page and know the token of the run.

mod assets;
mod counted;
mod frame;
mod http;
mod hub;
mod live;
mod look;
mod meshes;
mod mixer;
mod operator_worker;
mod page;
mod recording_view;
mod robot_view;
mod scene;
mod server;
mod shares;
mod worker;

pub use assets::{ASSETS, Asset};
pub use frame::{BODIES, FIELDS, Field, LENGTH, LatestMessages, POSE, VERSION, encode, present};
pub use http::POLICY;
pub use live::{GONE_AFTER_NS, Readers};
pub use look::{Colour, Look, LookError, NamedMesh, Part, Shape};
pub use meshes::{MESH_BYTES_MAX, MeshFolder};
pub use mixer::{EDGE_S, KeyPoses, PersonOf};
pub use operator_worker::HOLD_FOR;
pub use recording_view::{RecordingView, RecordingViewBuilder};
pub use robot_view::{Mesh, RobotView};
pub use scene::scene;
pub use server::{PORT, Server};
pub use shares::Shares;

/// Why nothing can be shown.
#[derive(Debug, thiserror::Error)]
pub enum ViewError {
    /// The instance's shared memory cannot be opened.
    #[error(transparent)]
    Bus(#[from] bus::BusError),
    /// The port cannot be had.
    #[error("port {port} of 127.0.0.1: {source}")]
    Listen {
        /// As asked for.
        port: u16,
        /// Why.
        source: std::io::Error,
    },
}
