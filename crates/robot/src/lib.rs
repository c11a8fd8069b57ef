//! Turns the texts of a URDF and of a robot file into a checked [`Model`], and never reads a file, a clock or
//! the environment. It never moves anything. The model has limits, forward kinematics, Jacobians and
//! collision geometry.
//!
//! - [`Model::from_text`] refuses everything that it does not understand. Errors name file, key, value and
//!   bound.
//! - Body 0 is the base. Body `1 + j` moves with joint `j`, in the frame of that joint's link.
//! - Positions are in metres and angles in radians, in the base frame unless a name says otherwise.

#![forbid(clippy::disallowed_macros, clippy::disallowed_methods, clippy::disallowed_types)]
// Bounds are written as `!(value <= bound)` so that NaN is refused.
#![allow(clippy::neg_cmp_op_on_partial_ord)]

mod arm;
mod collision;
mod commanded;
mod draft;
mod effective;
mod environment;
mod error;
mod file;
mod fit;
mod gripper;
mod inertia;
mod kinematics;
pub mod limbs;
mod limits;
mod model;
mod names;
mod nearest;
mod payload;
mod pointing;
mod points;
mod pose;
mod proposal;
mod read;
mod refute;
mod segment;
mod shapes;

mod urdf;
mod visual;
mod xml;

pub use arm::Arm;
pub use collision::{AllowedPair, AllowedReason, CAPSULES_MAX, Capsule, Pair};
pub use draft::{Draft, draft};
pub use environment::{BOXES_MAX, BoxEntry, Environment, Obstacle, PLANES_MAX, PlaneEntry, Solid};
pub use error::RobotError;
pub use file::urdf_file;
pub use gripper::{Finger, Gripper};
pub use inertia::Inertia;
pub use kinematics::Frames;
pub use limbs::Limbs;
pub use limits::JointLimits;
pub use model::{CONTROLLERS_MAX, Controller, Model, Texts};
pub use names::Names;
pub use nearest::NearestToArm;
pub use payload::{PAYLOAD_MAX_KG, PAYLOAD_REACH_MAX_M, Payload};
pub use pointing::{POINTING_JOINTS, PointingJoints};
pub use points::SpeedPoint;
pub use pose::Pose;
pub use proposal::{ARM_SDK_INDICES, Motor, Proposal, SetpointKind};
pub use read::read_urdf;
pub use segment::{SegmentDistance, segment_distance};
pub use shapes::{Hull, hull_volume_oracle, segment_distance_oracle};
pub use visual::{Form, MeshVisual, Visual};
