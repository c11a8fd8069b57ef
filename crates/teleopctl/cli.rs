//! The command line.

use clap::{Args, Parser, Subcommand, ValueEnum};
use std::path::PathBuf;

/// Commands of an operator to a running teleopd.
#[derive(Debug, Parser)]
#[command(name = "teleopctl", version)]
pub struct Cli {
    /// Folder of the instance. A program installed in /usr/bin defaults to /run/teleop if that exists.
    #[arg(long, value_name = "DIR", default_value_os_t = pipeline::default_run_dir(), global = true)]
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
    /// Says what a hand carries, as a point mass; 0 is an empty hand. Only while the robot is Disengaged and at rest.
    Payload(PayloadArgs),
    /// Stops the robot now, and latches.
    Estop,
}

#[derive(Args, Debug)]
pub struct CalibrateArgs {
    /// The operator's name, which is the file's: letters, digits, `-` and `_`.
    #[arg(value_parser = name)]
    pub name: String,
    /// Settings file, whose `ingest.operators` names the folder. A program installed in /usr/bin defaults to
    /// /etc/teleop/teleop.toml if that exists.
    #[arg(long, value_name = "FILE", default_value_os_t = pipeline::default_config())]
    pub config: PathBuf,
    /// Folder to write to, in place of that of the settings.
    #[arg(long, value_name = "DIR")]
    pub folder: Option<PathBuf>,
}

#[derive(Args, Debug)]
pub struct PayloadArgs {
    /// Which hand.
    pub hand: Hand,
    /// Mass, kg.
    #[arg(value_name = "KG", value_parser = finite, allow_negative_numbers = true)]
    pub mass_kg: f64,
    /// Centre of mass, in m, in the frame of the link that the arm's last joint moves; without it that of the robot file.
    #[arg(long, value_name = "X,Y,Z", value_parser = place, allow_hyphen_values = true)]
    pub centre: Option<[f64; 3]>,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum Hand {
    /// The left one.
    Left,
    /// The right one.
    Right,
}

fn finite(text: &str) -> Result<f64, String> {
    let number = text.trim().parse().ok().filter(|number: &f64| number.is_finite());
    number.ok_or_else(|| "must be a number".into())
}

fn place(text: &str) -> Result<[f64; 3], String> {
    let numbers: Result<Vec<f64>, String> = text.split(',').map(finite).collect();
    numbers?.try_into().map_err(|_| "must be three numbers: x,y,z".into())
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
