//! All integration tests of `layouts` except the one that counts allocations. They are one program, so they are
//! linked once.

mod client;
mod custom;
mod frames;
mod golden;
mod local;
mod noise;
mod outliers;
mod refused;
mod salt;
