//! The command line of `teleopd-ros2`.

use clap::{Args, Parser, Subcommand};
use config::RobotChoice;
use std::path::PathBuf;

/// Drives a robot that speaks ROS 2. `teleopd up` starts it without a command, if the settings name it in driver.program.
#[derive(Debug, Parser)]
#[command(name = "teleopd-ros2", version)]
pub struct Cli {
    /// Command.
    #[command(subcommand)]
    pub command: Command,
}

/// Commands of the program.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Checks the robot before it is driven: controllers, description, joint states, emergency stop, posture. Sends
    /// nothing. Exits with 1 if a check failed.
    Preflight(Preflight),
}

/// Options of `preflight`.
#[derive(Args, Debug)]
pub struct Preflight {
    /// Settings that name the robot and its domain.
    #[arg(long, value_name = "FILE", default_value_os_t = instance::default_config())]
    pub config: PathBuf,
    /// Another robot than that of the settings: its name, or its robot file.
    #[arg(long, value_name = "NAME|FILE")]
    pub robot: Option<RobotChoice>,
    /// Also print the messages that would be sent to the robot as it stands.
    #[arg(long)]
    pub dry_run: bool,
}
