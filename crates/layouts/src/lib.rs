//! Turns every client's layout of a person into SMPL-22 in metres, x forward, y left, z up, quaternions x y z w. Never does
//! IO, never reads a clock, never allocates or panics in [`Layouts::convert`], and judges no person: that is left to
//! `skeleton`, which sees the converted frame.
//!
//! A map says where each joint of SMPL-22 comes from, which way the axes point, and what is sent:
//! - positions alone, of which joints that nobody sends are derived where that is possible;
//! - positions and global rotations;
//! - local rotations: forward kinematics along the layout's own tree, and then over a neutral skeleton of nominal lengths.
//!   The directions of the limbs are right, the lengths are those of nobody.
//!
//! What cameras see trembles, and sometimes one joint is far off for one frame: [`Noise`] filters both before it is judged.
mod axes;
mod builtin;
mod convert;
mod error;
mod file;
mod map;
mod neutral;
mod noise;
mod outlier;

pub use axes::{Axes, Direction};
pub use convert::Refusal;
pub use error::LayoutError;
pub use map::{Layouts, Map, Sends};
pub use noise::{Noise, NoiseState};
