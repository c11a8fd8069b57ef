//! Converts every client's layout of a person to SMPL-22 in metres, x forward, y left, z up, quaternions x y z w.
//! Never does IO, never reads a clock, never allocates or panics in [`Layouts::convert`], and judges no person.
//! `skeleton` judges the converted frame.
//!
//! A map gives the source of each joint of SMPL-22, the directions of the axes, and the kind of data that is sent:
//! - positions alone: joints that the layout does not send are derived where possible;
//! - positions and global rotations;
//! - local rotations: forward kinematics along the layout's own tree, and then over a neutral skeleton of nominal
//!   lengths. The directions of the limbs are right, but the lengths are not the person's.
//!
//! Camera data is noisy, and sometimes a single joint is far off for one frame. [`Noise`] filters both before the
//! frame is judged. [`Lengths`] gives limbs the lengths of the session. [`Lifter`] finds their directions in the points of an
//! image.

#![forbid(clippy::disallowed_macros, clippy::disallowed_methods, clippy::disallowed_types)]

mod axes;
mod builtin;
mod closure;
mod convert;
mod error;
mod file;
mod lengths;
mod lift;
mod lifter;
mod map;
mod neutral;
mod noise;
mod outlier;
mod unseen;

pub use axes::{Axes, Direction};
pub use convert::Refusal;
pub use error::LayoutError;
pub use lengths::Lengths;
pub use lift::{LastImage, Lift};
pub use lifter::{
    DIRECTIONS, ImagePoints, LENGTHS, LIFTER_INPUTS, LIFTER_OUTPUTS, LIFTER_WIDTHS, Lifted, Lifter, LifterManifest,
    POINTS, Point,
};
pub use map::{Layouts, Map, Sends};
pub use noise::{Noise, NoiseState};
