//! The command line of `teleopd-ros2`.

use clap::{Args, Parser, Subcommand};
use config::RobotChoice;
use std::path::PathBuf;

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
    /// Publishes the joints of a running instance on /joint_states, and its robot on /robot_description, for RViz and other
    /// programs that watch. Commands nothing. Ctrl-C ends it.
    States(States),
}

/// Options of `states`.
#[derive(Args, Clone, Debug)]
pub struct States {
    /// Folder of the running instance.
    #[arg(long, value_name = "DIR", default_value_os_t = instance::default_run_dir())]
    pub run_dir: PathBuf,
    /// Settings of the instance, with its robot, and the domain and network interface of ROS 2.
    #[arg(long, value_name = "FILE", default_value_os_t = instance::default_config())]
    pub config: PathBuf,
    /// Robot of the instance, if it is not that of the settings.
    #[arg(long, value_name = "NAME|FILE")]
    pub robot: Option<RobotChoice>,
}
