//! All integration tests of `plant`. They are one program, so they are linked once.

mod agrees_with_robot;
mod allocation;
mod dynamics;
mod following;
mod judging;
mod readers;
mod refusals;
mod support;
mod watchdog;

/// Counts the allocations of each thread.
#[global_allocator]
static ALLOCATOR: rt::CountingAllocator = rt::CountingAllocator;
