//! Records a running instance, or summarises or shows a recording.

use std::process::ExitCode;

fn main() -> ExitCode {
    rt::abort_on_panic();
    record::main()
}
