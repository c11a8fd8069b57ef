//! `eval`: compares retargeting methods, and measures how closely the robot follows. See `eval --help`.

use std::process::ExitCode;

fn main() -> ExitCode {
    rt::abort_on_panic();
    rt::finish("eval", eval::run::run(&report::parse()))
}
