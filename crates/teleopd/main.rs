//! teleopd: one binary for all processes, so that they cannot disagree about a layout.

use std::process::ExitCode;

/// Counts what the loops allocate after READY, so that the daemon's own figures show it.
#[global_allocator]
static ALLOCATOR: rt::CountingAllocator = rt::CountingAllocator;

fn main() -> ExitCode {
    teleopd::main()
}
