//! All integration tests of `retarget`. They are one program, so they are linked once.

mod allocations;
mod contact;
mod kinematics;
mod limb_trajectory;
mod network;
mod policy;
mod prediction;
mod rate;
mod resampling;
mod robot;
mod smoothness;
mod support;

/// It counts the allocations of each thread, and each test has its own thread.
#[global_allocator]
static ALLOCATOR: rt::CountingAllocator = rt::CountingAllocator;
