//! The command line.

use clap::{Args, Parser, Subcommand, ValueEnum};
use std::path::PathBuf;

/// Commands of an operator to a running teleopd.
#[derive(Debug, Parser)]
#[command(name = "teleopctl", version)]
pub struct Cli {
    /// Folder of the instance. A program installed in /usr/bin defaults to /run/teleop if that exists.
    #[arg(long, value_name = "DIR", default_value_os_t = instance::default_run_dir(), global = true)]
    pub run_dir: PathBuf,
    #[command(subcommand)]
    pub command: Command,
}

#[derive(Debug, Subcommand)]
pub enum Command {
    /// Prints control's status.
    Status(StatusArgs),
    /// Draws the instance in this terminal ten times a second, until q. Shows mode, rates, ages, joints, the
    /// smallest clearance, faults and events.
    Watch,
    /// Measures an operator and stores the result for later sessions. The operator holds a T-pose for 2 s, then
    /// moves arms and elbows.
    Calibrate(CalibrateArgs),
    /// Engages and holds the enable until Ctrl-C. Then releases.
    Engage {
        /// Only this arm follows. The other one stays where it is.
        #[arg(long, value_enum, value_name = "SIDE")]
        arm: Option<Hand>,
    },
    /// Holds the clutch until Ctrl-C: the robot stands, and the person moves freely. Then the robot moves slowly to where the
    /// person is, and follows again.
    Clutch,
    /// Lets the person lead the policy's arms until Ctrl-C, from where they are. Then the policy leads again.
    Takeover {
        /// Only this arm. The policy goes on with the other one.
        #[arg(long, value_enum, value_name = "SIDE")]
        arm: Option<Hand>,
    },
    /// Slowly brings back a robot that is outside its limits or too close to itself, until Ctrl-C. Never engages.
    Recover,
    /// Releases the enable, whichever client holds it. The robot stops and keeps its posture.
    Release,
    /// Resets a latched stop once its cause is gone and the robot is at rest. Never engages.
    Reset,
    /// Sets the load in a hand, as a point mass. 0 is an empty hand. Only while the robot is Disengaged and at rest.
    Payload(PayloadArgs),
    /// Stops the robot now and latches the stop.
    Estop,
}

#[derive(Args, Debug)]
pub struct CalibrateArgs {
    /// The operator's name, also the name of the file: letters, digits, `-` and `_`.
    #[arg(value_parser = name)]
    pub name: String,
    /// Settings file. Its `ingest.operators` names the folder. A program installed in /usr/bin defaults to
    /// /etc/teleop/teleop.toml if that exists.
    #[arg(long, value_name = "FILE", default_value_os_t = instance::default_config())]
    pub config: PathBuf,
    /// Folder to write to, instead of the one in the settings.
    #[arg(long, value_name = "DIR")]
    pub folder: Option<PathBuf>,
    /// End when the process with this number is no longer the parent.
    #[arg(long, value_name = "PID", hide = true)]
    pub child_of: Option<u32>,
}

#[derive(Args, Debug)]
pub struct PayloadArgs {
    /// Left or right hand.
    pub hand: Hand,
    /// Mass, kg.
    #[arg(value_name = "KG", value_parser = rt::number, allow_negative_numbers = true)]
    pub mass_kg: f64,
    /// Centre of mass, m, in the frame of the link that the arm's last joint moves. Default: the centre in the
    /// robot file.
    #[arg(long, value_name = "X,Y,Z", value_parser = place, allow_hyphen_values = true)]
    pub centre: Option<[f64; 3]>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Hand {
    /// The left one.
    Left,
    /// The right one.
    Right,
}

fn place(text: &str) -> Result<[f64; 3], String> {
    let numbers: Result<Vec<f64>, String> = text.split(',').map(rt::number).collect();
    numbers?.try_into().map_err(|_| "must be three numbers: x,y,z".into())
}

fn name(text: &str) -> Result<String, String> {
    if config::Operator::may_be_called(text) {
        Ok(text.to_owned())
    } else {
        Err("must be 1 to 32 letters, digits, - or _".into())
    }
}

#[derive(Args, Debug)]
pub struct StatusArgs {
    /// Print as JSON.
    #[arg(long)]
    pub json: bool,
}
