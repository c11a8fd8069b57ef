//! Capsules for a robot file: fits them around meshes and primitives, proves which pairs can never meet, checks both.

pub mod check;
pub mod error;
pub mod fit;
pub mod mesh;
pub mod plan;
pub mod prove;
pub mod scene;
pub mod split;
pub mod write;
