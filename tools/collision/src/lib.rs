//! The content of a robot file beyond its URDF. It consists of capsules fitted around meshes and primitives,
//! pairs that are proved never to meet, and accelerations that the motors can always give. The tool also draws
//! the robot.
//!
//! - `fit`, `split`, `mesh`, `scene`, `plan`: few and small capsules that contain every point of a surface.
//! - `first`, `near`: a first plan, made from the robot alone.
//! - `prove`, `fragments`, `judge`, `write`: an allowed pair is on one body, adjacent, or proved clear. The proof is
//!   branch and bound over the whole box of the limits in force. Samples can only refute.
//! - `check`: checks containment and every reason again, from a robot file and the meshes.
//! - `cover`: how far the shape of each link sticks out of its capsules, and how much larger the capsules are.
//! - `dynamics`, `limits`, `report`: torques by inverse dynamics over random states, and limits that respect
//!   the motors.
//! - `draw`: front and side view, with capsules over their contents.

// Bounds are written as `!(value <= bound)` so that NaN is rejected.
#![allow(clippy::neg_cmp_op_on_partial_ord)]

pub mod check;
pub mod cover;
pub mod draw;
pub mod dynamics;
pub mod error;
pub mod first;
pub mod fit;
pub mod fragments;
pub mod judge;
pub mod limits;
pub mod mesh;
pub mod near;
pub mod plan;
pub mod prove;
pub mod report;
pub mod scene;
pub mod split;
pub mod write;
