//! All integration tests of `operator`. They are one program, so that it is linked once.

mod allocation;
mod codec;
mod session;
mod socket;
mod socket_file;

#[global_allocator]
static ALLOCATOR: rt::CountingAllocator = rt::CountingAllocator;
