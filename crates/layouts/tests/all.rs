//! All integration tests of `layouts` but the one that counts allocations: one program, so that it is linked once.

mod client;
mod custom;
mod frames;
mod golden;
mod local;
mod noise;
mod outliers;
mod refused;
mod salt;
