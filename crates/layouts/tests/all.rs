//! All integration tests of `layouts`. They are one program, so they are linked once.

mod allocations;
mod before_camera;
mod client;
mod custom;
mod frames;
mod golden;
mod lengths;
mod lifter;
mod local;
mod noise;
mod outliers;
mod refused;
mod salt;

/// It counts the allocations of each thread, and each test has its own thread.
#[global_allocator]
static ALLOCATOR: rt::CountingAllocator = rt::CountingAllocator;
