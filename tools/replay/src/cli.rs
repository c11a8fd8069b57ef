//! The command line.

use crate::{batch, keyposes, say};
use clap::{Parser, Subcommand};
use config::RobotChoice;
use motion::{CalibrationMode, LoadOptions};
use std::ffi::OsStr;
use std::path::{Path, PathBuf};

/// Publishes a recorded motion to a running teleopd, or writes what the robot would do.
#[derive(Debug, Parser)]
#[command(name = "replay", version, args_conflicts_with_subcommands = true, subcommand_negates_reqs = true)]
#[command(disable_help_subcommand = true)]
pub struct Cli {
    /// Another task than to play a motion.
    #[command(subcommand)]
    pub task: Option<Task>,
    /// The motion: a motion file (.bvh, .npy, .npz), a recording (.mcap), a joint trajectory of both arms
    /// (.csv, as `replay keyposes interpolate` writes), `builtin`, `pick-and-place`, or `builtin:calibration`. The last one
    /// performs the motions of `teleopctl calibrate`, again and again, even while the robot is not engaged.
    #[arg(required_unless_present = "compare")]
    pub file: Option<PathBuf>,
    /// 1 is the recorded speed, and 0.1 to 10 are allowed. A slow motion gets additional frames between its
    /// own.
    #[arg(long, value_name = "FACTOR", default_value_t = 1.0, value_parser = rt::number, allow_negative_numbers = true)]
    pub speed: f64,
    #[command(flatten)]
    pub load: LoadOptions,
    /// Begin again at the end, with a blended seam.
    #[arg(long = "loop")]
    pub looped: bool,
    /// Run all stages here, and write the commands at 1500 Hz to this CSV file, with a JSON file beside it.
    #[arg(long, value_name = "OUT.csv")]
    pub offline: Option<PathBuf>,
    /// Also write every message of the run, and the inputs of every control tick, to this recording (.mcap).
    #[arg(long, value_name = "OUT.mcap", requires = "offline")]
    pub record: Option<PathBuf>,
    /// Also draw the run: joints against their limits, clearance, latency, modes.
    #[arg(long, value_name = "OUT.png", requires = "offline")]
    pub plot: Option<PathBuf>,
    /// Run the stages again over the inputs of a recording of --record. Compare targets, commands and statuses with the
    /// recorded ones, bit for bit. Exits with 1 if one differs or is missing, or if the recording is incomplete.
    #[arg(long, value_name = "FILE.mcap", conflicts_with_all = ["file", "looped", "offline", "run_dir", "socket"])]
    pub compare: Option<PathBuf>,
    /// Source of the elbow hinges: the first 10 s of the motion, or all of it (which looks ahead), or the rig. The rig
    /// requires joints without rotation in the T-pose. The person of a joint trajectory or a recording has such a rig.
    #[arg(long, value_name = "first-10s|clip|none|rig", default_value = "first-10s", value_parser = calibration)]
    pub calibration: CalibrationMode,
    /// Settings for --offline, and the robot of a joint trajectory. A program installed in /usr/bin defaults to
    /// /etc/teleop/teleop.toml if that exists.
    #[arg(long, value_name = "FILE", default_value_os_t = instance::default_config())]
    pub config: PathBuf,
    /// Another robot than that of the settings, for --offline, --compare and joint trajectories. NAME has its robot
    /// file and its weights in the same folders as the settings' own. A value with a slash or .toml is a file.
    #[arg(long, value_name = "NAME|FILE")]
    pub robot: Option<RobotChoice>,
    /// Folder of the running instance. A program installed in /usr/bin defaults to /run/teleop if that exists.
    #[arg(long, value_name = "DIR", default_value_os_t = instance::default_run_dir())]
    pub run_dir: PathBuf,
    /// Publish through this socket of ingest (skeleton.sock in the folder of the instance) instead of shared
    /// memory. Any user in the socket's group may do so. The operator's socket must be in the same folder.
    #[arg(long, value_name = "PATH", conflicts_with_all = ["offline", "run_dir"])]
    pub socket: Option<PathBuf>,
}

/// A subcommand.
#[derive(Debug, Subcommand)]
pub enum Task {
    #[allow(missing_docs, reason = "the command lines have them")]
    Batch(batch::Cli),
    #[allow(missing_docs, reason = "the command lines have them")]
    Keyposes(keyposes::Cli),
    #[allow(missing_docs, reason = "the command lines have them")]
    Say(say::Cli),
}

impl Task {
    /// Returns the subcommand whose name a link to this program has, with or without the `teleop-` of installed
    /// programs. It takes the arguments of this process.
    pub fn from_link(program: &OsStr) -> Option<Self> {
        let name = Path::new(program).file_name()?.to_str()?;
        match name.strip_prefix("teleop-").unwrap_or(name) {
            "batch" => Some(Self::Batch(Parser::parse())),
            "keyposes" => Some(Self::Keyposes(Parser::parse())),
            "say" => Some(Self::Say(Parser::parse())),
            _ => None,
        }
    }
}

fn calibration(text: &str) -> Result<CalibrationMode, String> {
    CalibrationMode::among(text, &CalibrationMode::ALL)
}
