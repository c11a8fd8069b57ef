//! All integration tests of `doors`. They are one program, so that it is linked once.

mod allocation;
mod bucket;
mod door;

#[global_allocator]
static ALLOCATOR: rt::CountingAllocator = rt::CountingAllocator;
