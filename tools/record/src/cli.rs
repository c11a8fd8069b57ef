//! The command line.

use clap::Parser;
use config::{Interface, Overrides, RobotChoice};
use std::path::PathBuf;

/// Records a running instance as an MCAP file, shows it live to other programs, or summarises a recording.
#[derive(Debug, Parser)]
#[command(name = "record", version)]
pub struct Cli {
    /// The file to write. It must not exist.
    #[arg(value_name = "OUT.mcap", required_unless_present_any = ["summary", "view", "foxglove"])]
    pub out: Option<PathBuf>,
    /// Folder of the running instance. A program installed in /usr/bin defaults to /run/teleop if that exists.
    #[arg(long, value_name = "DIR", default_value_os_t = instance::default_run_dir())]
    pub run_dir: PathBuf,
    /// Settings of the instance. Its robot is drawn, and attached to the file. A program installed in /usr/bin
    /// defaults to /etc/teleop/teleop.toml if that exists.
    #[arg(long, value_name = "FILE", default_value_os_t = instance::default_config())]
    pub config: PathBuf,
    /// Robot of the instance or of the recording, if it is not that of the settings.
    #[arg(long, value_name = "NAME|FILE")]
    pub robot: Option<RobotChoice>,
    /// Pictures, targets, commands and states per second. Every skeleton and status is recorded at any rate.
    #[arg(long, value_name = "HZ", default_value_t = 60.0, conflicts_with = "summary", value_parser = rt::number, allow_negative_numbers = true)]
    pub rate: f64,
    /// Record every target, command and state that can be seen. Pictures stay at --rate.
    #[arg(long, conflicts_with = "summary")]
    pub full: bool,
    /// End after this many seconds (default: at SIGINT or SIGTERM).
    #[arg(long, value_name = "N", conflicts_with = "summary", value_parser = rt::number, allow_negative_numbers = true)]
    pub seconds: Option<f64>,
    /// Set this if the instance was started with this flag. It is part of the settings in the file.
    #[arg(long, conflicts_with = "summary")]
    pub engage_without_realtime: bool,
    /// Interface with which the instance was started: direct, jtc100 or jtc100-restart.
    #[arg(long, value_name = "NAME", value_parser = interface, conflicts_with = "summary")]
    pub interface: Option<Interface>,
    /// End, as at a signal, when this process is no longer the parent.
    #[arg(long, value_name = "PID", conflicts_with = "summary")]
    pub child_of: Option<u32>,
    /// Print a summary of this recording: duration, topics, counts, modes, and faults as text.
    #[arg(long, value_name = "FILE.mcap", conflicts_with = "out")]
    pub summary: Option<PathBuf>,
    /// Show this recording in a browser on this machine, with a slider. Prints the address.
    #[arg(long, value_name = "FILE.mcap", conflicts_with_all = ["out", "summary", "plot"])]
    pub view: Option<PathBuf>,
    /// Serve the channels of a recording live to Foxglove and Lichtblick, at this port of 127.0.0.1 (0: any free one).
    #[arg(long, value_name = "PORT", num_args = 0..=1, require_equals = true, default_missing_value = "8765", conflicts_with_all = ["summary", "view", "port", "plot", "meshes"])]
    pub foxglove: Option<u16>,
    /// Port of 127.0.0.1 for --view. 0 means any free port.
    #[arg(long, value_name = "PORT", default_value_t = view::PORT, requires = "view")]
    pub port: u16,
    /// With --view: draw the robot with your own mesh files (DAE, STL, GLB, OBJ). They are the files that the
    /// robot's URDF or look file names, found below this folder by the end of their paths.
    #[arg(long, value_name = "DIR", requires = "view")]
    pub meshes: Option<PathBuf>,
    /// Also draw the recording: joints against their limits, clearance, latency, modes.
    #[arg(long, value_name = "OUT.png", requires = "summary")]
    pub plot: Option<PathBuf>,
}

impl Cli {
    /// Returns the changes that the instance's command line made to the settings.
    pub fn overrides(&self) -> Overrides {
        let (interface, robot) = (self.interface, self.robot.clone());
        Overrides { engage_without_realtime: self.engage_without_realtime, interface, robot }
    }
}

fn interface(text: &str) -> Result<Interface, String> {
    let found = Interface::ALL.into_iter().find(|interface| interface.name() == text);
    found.ok_or_else(|| format!("must be one of {}", Interface::NAMES.join(", ")))
}
