//! `train`: from motion files to a weights file. See `train --help`.

use clap::Parser;
use std::process::ExitCode;

fn main() -> ExitCode {
    match train::run::run(&train::cli::Cli::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("train: {error}");
            ExitCode::from(error.exit_code())
        }
    }
}
