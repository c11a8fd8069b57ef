//! The content of a robot file beyond its URDF. It consists of capsules fitted around meshes and primitives, pairs that
//! are proved never to meet, and accelerations that the motors can always give.

#![allow(missing_docs, reason = "the library of a program: only the program, tests and other tools use it")]
// Bounds are written as `!(value <= bound)` so that NaN is rejected.
#![allow(clippy::neg_cmp_op_on_partial_ord)]

pub mod blocking_pairs;
pub mod check;
pub mod content;
pub mod cover;
pub mod error;
pub mod first;
pub mod fit;
pub mod fragments;
pub mod judge;
pub mod limits;
pub mod mesh;
pub mod narrow;
pub mod plan;
pub mod prove;
pub mod report;
pub mod scene;
pub mod split;
pub mod write;
