//! Capsules for a robot file: fits them around meshes and primitives, proves which pairs can never meet, checks both.

// Bounds are written as `!(value <= bound)` so that NaN is refused.
#![allow(clippy::neg_cmp_op_on_partial_ord)]

pub mod check;
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
