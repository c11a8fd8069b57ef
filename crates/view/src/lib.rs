//! Shows a running instance in a browser, and forwards an operator's requests from there.
//!
//! One thread reads the instance's messages 60 times a second without waking any other process. A thread for
//! every open page sends the updates. A page can only send requests. They pass through the operator socket like
//! those of `teleopctl`, and `control` decides. A page can also be a client. Its person is a mix of key poses, or the
//! person in a webcam's image, or the person who wears a headset. The page sends that person over the skeleton socket. The server listens on the loopback
//! interface, or with TLS at another address. A request must come from the server's own page and carry the token of the run.

mod assets;
mod calibration;
mod counted;
mod frame;
mod headset;
mod http;
mod hub;
#[cfg(test)]
mod ingest_double;
mod landmarker;
mod live;
mod look;
mod meshes;
mod mixer;
mod operator_worker;
mod page;
mod recording_view;
mod robot_view;
mod scene;
mod secure;
mod server;
mod session;
mod shares;
mod sight;
mod vision;
mod webcam;
mod worker;

pub use assets::{ASSETS, Asset};
pub use calibration::Measuring;
pub use frame::{FIELDS, Field, LatestMessages, POSE, TURNS, VERSION, encode, length, present};
pub use headset::{BODY_BYTES, HEADSET_BYTES, HeadsetFrame};
pub use http::{POLICY, camera_policy};
pub use landmarker::Landmarker;
pub use live::{GONE_AFTER_NS, Readers};
pub use look::{Colour, Look, LookError, NamedMesh, Part, Shape};
pub use meshes::{MESH_BYTES_MAX, MeshFolder};
pub use mixer::{EDGE_S, KeyPoses, PersonOf};
pub use operator_worker::HOLD_FOR;
pub use page::{or_later, waits};
pub use recording_view::{RecordingView, RecordingViewBuilder};
pub use robot_view::{Mesh, RobotView};
pub use scene::scene;
pub use secure::{PageStream, Secure, SecureError};
pub use server::{LiveOptions, PORT, Server};
pub use shares::Shares;
pub use sight::{AGE_MS_MAX, LANDMARKS, NOBODY_BYTES, Person, Refusal, SIGHT_BYTES, Sight};
pub use vision::{VISION_FOLDER, VisionFiles};
pub use webcam::IMAGES_PER_S_MAX;

/// Errors that prevent the view from starting.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs, reason = "the texts name the fields")]
pub enum ViewError {
    #[error(transparent)]
    Bus(#[from] bus::BusError),
    #[error("port {port}: {source}")]
    Listen { port: u16, source: std::io::Error },
}
