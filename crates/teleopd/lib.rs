//! The processes of teleopd and the commands about them. A library, so that a harness can start the same processes from
//! its own executable (`Children` starts the running one again); the binary `teleopd` is `main` alone.

mod check;
mod children;
mod cli;
mod demo;
mod doctor;
mod exit;
mod figure;
mod figures;
mod operate;
mod process;
mod processes;
mod recorder;
mod report;
mod timeline;
mod up;
mod view;

use clap::Parser;
use cli::{Cli, Command};
use rt::err;
use std::process::ExitCode;

pub use children::Children;
pub use cli::Place;
pub use exit::{Exit, Failure};
pub use operate::Operator;
pub use process::realtime::placement;
pub use processes::{PROCESSES, Row, TABLE};
pub use recorder::Recorder;
pub use report::Report;

/// Does what the command line says; the exit code is one of `Exit`.
pub fn main() -> ExitCode {
    rt::abort_on_panic();
    // Before any thread starts: the stages count the same way here as in every tool. The processes report the outcome.
    let _ = rt::flush_denormals();
    let outcome = match Cli::parse().command {
        Command::Ingest(place) => process::ingest::run(&place).map(|()| Exit::Ok),
        Command::Retarget(place) => process::retarget::run(&place).map(|()| Exit::Ok),
        Command::Control(place) => process::control::run(&place).map(|()| Exit::Ok),
        Command::Robot(place) => process::robot::run(&place).map(|()| Exit::Ok),
        Command::Sim(place) => process::sim::run(&place).map(|()| Exit::Ok),
        Command::Up(options) => up::run(&options),
        Command::Demo(options) => demo::run(&options),
        Command::Check(place) => check::run(&place),
        Command::View(options) => view::run(&options),
        Command::Doctor(options) => doctor::run(&options),
    };
    match outcome {
        Ok(exit) => exit.into(),
        Err(failure) => {
            err!("teleopd: {}", failure.text);
            failure.exit.into()
        }
    }
}
