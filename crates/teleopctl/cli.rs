//! The command line.

use clap::{Args, Parser, Subcommand};
use std::path::PathBuf;

/// Commands of an operator to a running teleopd.
#[derive(Debug, Parser)]
#[command(name = "teleopctl", version)]
pub struct Cli {
    /// Folder of the instance.
    #[arg(long, value_name = "DIR", default_value = pipeline::DEFAULT_RUN_DIR, global = true)]
    pub run_dir: PathBuf,
    #[command(subcommand)]
    pub command: Command,
}

#[derive(Debug, Subcommand)]
pub enum Command {
    /// Prints what control says of itself.
    Status(StatusArgs),
    /// Draws the instance in this terminal, ten times a second, until q: mode, rates, ages, joints, what is nearest, faults,
    /// what happened.
    Watch,
    /// Measures an operator, who holds a T-pose for 2 s and then moves arms and elbows, and stores it for later sessions.
    Calibrate(CalibrateArgs),
    /// Engages, and holds the enable until Ctrl-C; then releases.
    Engage,
    /// Brings a robot back that stands outside its limits or too close to itself, slowly, until Ctrl-C; never engages.
    Recover,
    /// Withdraws the enable, whoever holds it: the robot stops and keeps its posture.
    Release,
    /// Clears a latched stop, once its cause is gone and the robot is at rest. Never engages.
    Reset,
    /// Stops the robot now, and latches.
    Estop,
}

#[derive(Args, Debug)]
pub struct CalibrateArgs {
    /// The operator's name, which is the file's: letters, digits, `-` and `_`.
    #[arg(value_parser = name)]
    pub name: String,
    /// Settings file, whose `ingest.operators` names the folder.
    #[arg(long, value_name = "FILE", default_value = "config/teleop.toml")]
    pub config: PathBuf,
    /// Folder to write to, in place of that of the settings.
    #[arg(long, value_name = "DIR")]
    pub folder: Option<PathBuf>,
}

fn name(text: &str) -> Result<String, String> {
    if pipeline::Operator::may_be_called(text) {
        Ok(text.to_owned())
    } else {
        Err("must be 1 to 32 letters, digits, - or _".into())
    }
}

#[derive(Args, Debug)]
pub struct StatusArgs {
    /// As JSON.
    #[arg(long)]
    pub json: bool,
}
