//! All integration tests of `bus`. They are one program, so that it is linked once.

mod abuse;
mod allocations;
mod faulty;
mod processes;
mod shared_memory;
mod support;

#[global_allocator]
static ALLOCATOR: rt::CountingAllocator = rt::CountingAllocator;
