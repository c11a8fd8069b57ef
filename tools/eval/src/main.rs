//! `eval`: compares retargeting methods, and measures how closely the robot follows. See `eval --help`.

use clap::Parser;
use rt::Failure;
use std::process::ExitCode;

fn main() -> ExitCode {
    rt::abort_on_panic();
    let outcome = eval::run::run(&eval::cli::Cli::parse());
    rt::finish("eval", outcome.map_err(|error| Failure::new(error.exit(), error)))
}
