//! What a robot file says beyond its URDF: capsules fitted around meshes and primitives, pairs that are proved never to
//! meet, accelerations that the motors can give everywhere; and a picture of it.
//!
//! - `fit`, `split`, `mesh`, `scene`, `plan`: capsules that contain every point of a surface, few and small.
//! - `prove`, `write`: an allowed pair is on one body, adjacent, or proved clear by branch and bound over the whole box of
//!   the limits in force; samples only refute.
//! - `check`: containment and every reason again, from a robot file and the meshes.
//! - `dynamics`, `limits`, `report`: torques by inverse dynamics over random states, and limits that respect the motors.
//! - `draw`: front and side view, capsules over the points they contain.

// Bounds are written as `!(value <= bound)` so that NaN is refused.
#![allow(clippy::neg_cmp_op_on_partial_ord)]

pub mod check;
pub mod draw;
pub mod dynamics;
pub mod error;
pub mod fit;
pub mod limits;
pub mod mesh;
pub mod plan;
pub mod prove;
pub mod report;
pub mod scene;
pub mod split;
pub mod write;
