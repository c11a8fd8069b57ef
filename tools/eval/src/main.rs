//! `eval`: compares retargeting methods, and measures how closely the robot follows. See `eval --help`.

use clap::Parser;
use std::process::ExitCode;

fn main() -> ExitCode {
    rt::abort_on_panic();
    match eval::run::run(&eval::cli::Cli::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("eval: {error}");
            ExitCode::from(error.exit_code())
        }
    }
}
