//! Runs the task that this program's name or its first argument chooses.

use std::process::ExitCode;

fn main() -> ExitCode {
    rt::abort_on_panic();
    replay::main()
}
