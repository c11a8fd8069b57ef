//! teleopd: one binary for all processes, so that they cannot disagree about a layout.

mod check;
mod children;
mod cli;
mod demo;
mod exit;
mod figure;
mod figures;
mod operate;
mod process;
mod processes;
mod report;
mod timeline;
mod up;

use clap::Parser;
use cli::{Cli, Command};
use exit::Exit;
use std::process::ExitCode;

fn main() -> ExitCode {
    let outcome = match Cli::parse().command {
        Command::Ingest(place) => process::ingest::run(&place).map(|()| Exit::Ok),
        Command::Retarget(place) => process::retarget::run(&place).map(|()| Exit::Ok),
        Command::Control(place) => process::control::run(&place).map(|()| Exit::Ok),
        Command::Sim(place) => process::sim::run(&place).map(|()| Exit::Ok),
        Command::Up(place) => up::run(&place),
        Command::Demo(options) => demo::run(&options),
        Command::Check(place) => check::run(&place),
    };
    match outcome {
        Ok(exit) => exit.into(),
        Err(failure) => {
            eprintln!("teleopd: {}", failure.text);
            failure.exit.into()
        }
    }
}
