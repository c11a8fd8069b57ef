//! The human side: checks the clients' frames and turns a person into four limb rotations. Never does IO, never
//! reads a clock, never allocates or panics in [`tick`], and knows no robot.
//!
//! Glossary: the *torso frame* is x forward, y left, z up of the chest. A *bone* is the unit vector from a joint to the
//! next one outwards. The *hinge* of an arm is the flexion axis of its elbow (right-hand rule, flexing moves the
//! forearm to the front). A *limb frame* is the rotation that takes bone and hinge of the T-pose to the measured ones.

#![forbid(clippy::disallowed_macros, clippy::disallowed_methods, clippy::disallowed_types)]

mod clock;
mod config;
mod geometry;
mod hinge;
mod limbs;
mod mirror;
mod person;
mod plausible;
mod posture;
mod reference;
mod session;
mod steps;
mod tick;

pub use config::{Config, DROP_REASONS, DropReason};
pub use geometry::slerp;
pub use hinge::Calibrator;
pub use limbs::{Hold, LimbFrames, TORSO_LEAN_RAD, limbs_from_positions_rotations, torso_rotation};
pub use mirror::mirror_image;
pub use plausible::{Chirality, chirality, stands};
pub use posture::{Pose, TPose};
pub use reference::{Calibration, LEAN_MAX_RAD};
pub use tick::{Input, Output, State, tick};
