//! `train`: from motion files to a weights file. See `train --help`.

use std::process::ExitCode;

fn main() -> ExitCode {
    rt::abort_on_panic();
    rt::finish("train", train::run::run(&report::parse()))
}
