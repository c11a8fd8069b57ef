//! The command line of `teleopd-ros2`.

use clap::{Parser, Subcommand};

pub use teleopd::Preflight;

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
