//! teleopctl: the binary of the operator's client.

use std::process::ExitCode;

fn main() -> ExitCode {
    teleopctl::main()
}
