//! Multilayer perceptrons at batch one or a few, without allocation, and the safetensors files that hold their weights.
//! They use the processor's widest vectors. Vectors with fused multiply-add give the same bits. The portable ones differ by
//! rounding. Never does IO and never reads a clock.

#![forbid(clippy::disallowed_macros, clippy::disallowed_methods, clippy::disallowed_types)]

mod kernel;
mod network;
mod weights;

pub use network::{Dense, Level, Perceptron, WIDTH_MAX, plain};
pub use weights::{
    HEADER_MAX_BYTES, WeightsError, WriteError, key, must, must_match, open, read_networks, read_tensor, rounded,
    sha256_hex, write_layers,
};
