//! teleopd: one binary for all processes, so that all use the same message layouts.

use std::process::ExitCode;

/// Counts the loops' allocations after READY. The daemon's own figures show the count.
#[global_allocator]
static ALLOCATOR: rt::CountingAllocator = rt::CountingAllocator;

fn main() -> ExitCode {
    teleopd::main()
}
