//! All integration tests of `telemetry`. They are one program, so that it is linked once.

mod stuck_log;
mod telemetry;

#[global_allocator]
static ALLOCATOR: rt::CountingAllocator = rt::CountingAllocator;
