//! The integration tests of `rt`, except that of the memory lock, which belongs to a process. They are one program,
//! so that it is linked once.

mod allocations;
mod machine;
mod time;

#[global_allocator]
static ALLOCATOR: rt::CountingAllocator = rt::CountingAllocator;
