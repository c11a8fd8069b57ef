//! Interpolation between key poses in the latent space, and files of motions. The poses and their motions
//! are those of `poses`.

pub mod error;
pub mod interpolate;
pub mod write;
