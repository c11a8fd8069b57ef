//! `train`: from motion files to a weights file. See `train --help`.

use clap::Parser;
use rt::Failure;
use std::process::ExitCode;

fn main() -> ExitCode {
    rt::abort_on_panic();
    let outcome = train::run::run(&train::cli::Cli::parse());
    rt::finish("train", outcome.map_err(|error| Failure::new(error.exit(), error)))
}
