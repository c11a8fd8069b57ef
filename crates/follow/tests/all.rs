//! All integration tests of `follow`. They are one program, so they are linked once.

mod allocations;
mod arm;
mod following;
mod gap;
mod hostile;
mod solver;
mod support;
mod wrist;

/// It counts the allocations of each thread, and each test has its own thread.
#[global_allocator]
static ALLOCATOR: rt::CountingAllocator = rt::CountingAllocator;
