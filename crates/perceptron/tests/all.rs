//! All integration tests of `perceptron`. They are one program, so they are linked once.

mod network;

/// It counts the allocations of each thread, and each test has its own thread.
#[global_allocator]
static ALLOCATOR: rt::CountingAllocator = rt::CountingAllocator;
