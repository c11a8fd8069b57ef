//! The command line.

use clap::{ArgGroup, Parser, ValueEnum};
use motion::CalibrationMode;
use std::path::PathBuf;

/// Measures retargeting methods side by side on recorded motion: how near they come to the human, to the best that the
/// arm can do, how smooth they are and how long they take. Or measures how closely the robot follows the person.
#[derive(Clone, Debug, Parser)]
#[command(name = "eval", version, group = ArgGroup::new("what").required(true))]
pub struct Cli {
    /// Folder of motion files, to measure retargeting methods on
    #[arg(long, value_name = "DIR", group = "what")]
    pub human: Option<PathBuf>,
    /// Folder of motion files, to be played through all stages in virtual time: the commands are compared with the person, and
    /// with the best that any motion within the limits can do
    #[arg(long, value_name = "DIR", group = "what")]
    pub following: Option<PathBuf>,
    /// Folder of motion files, of which `ingest` is shown every frame at several rates: counts what it refuses
    #[arg(long, value_name = "DIR", group = "what")]
    pub refusals: Option<PathBuf>,
    /// --refusals: frames a second, 20 to 240
    #[arg(long, value_name = "HZ", value_delimiter = ',', default_values_t = [20.0, 30.0, 60.0, 120.0])]
    pub rates: Vec<f64>,
    /// Settings that --following and --refusals play with
    #[arg(long, value_name = "FILE", default_value = "config/teleop.toml")]
    pub config: PathBuf,
    /// --following: the delay between person and command that is judged, ms, beside 60 and 200
    #[arg(long, value_name = "MS", default_value_t = 120.0)]
    pub delay_ms: f64,
    /// --following: leave out the best that any motion can do
    #[arg(long)]
    pub no_optimum: bool,
    /// Robot file
    #[arg(long, value_name = "FILE", default_value = "config/robots/tiago_dual.toml")]
    pub robot: PathBuf,
    /// Our weights, with or without .safetensors; the manifest stands beside them
    #[arg(long, value_name = "FILE", default_value = DEFAULT_WEIGHTS, value_parser = tensors)]
    pub weights: PathBuf,
    /// Folder of the learned baselines' weights
    #[arg(long, value_name = "DIR", default_value = "weights/baselines")]
    pub baselines: PathBuf,
    /// Clips: names separated by commas, or all [default: every fifth starting with the third, which training leaves
    /// out; all if there are fewer than five, or for --following and --refusals]
    #[arg(long, value_name = "NAMES")]
    pub clips: Option<String>,
    /// Methods, separated by commas [default: all whose weights are there]
    #[arg(long, value_name = "NAMES", value_delimiter = ',')]
    pub methods: Option<Vec<String>>,
    /// What each clip's elbow hinges are estimated from: its first 10 s, as live; all of it, which looks ahead; nothing but
    /// the momentary elbow plane; or the rig, for motions that this project makes itself
    #[arg(long, value_name = "first-10s|clip|none|rig", default_value = "first-10s", value_parser = calibration)]
    pub calibration: CalibrationMode,
    /// Where limb rotations are compared: relative to the chest, or in space with the human's torso turning and the
    /// robot's upright and facing where the human faces first. Methods are given the chest's in both cases
    #[arg(long, value_enum, default_value = "chest")]
    pub frame: Frame,
    /// Take every N-th frame; jerk and flips need all of them
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub stride: usize,
    /// Write the figures as JSON
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
    /// Draw the figures as SVG files into this folder; for --following one picture a clip
    #[arg(long, value_name = "DIR", visible_alias = "plots")]
    pub plot: Option<PathBuf>,
    /// Also measure the eleven named motions, beside what the paper reports
    #[arg(long)]
    pub paper_table: bool,
    /// Draw human, paper, S3LE and ours in named poses as an SVG file
    #[arg(long, value_name = "FILE")]
    pub figure3: Option<PathBuf>,
    /// Also interpolate between random key poses in the latent space and in joint space
    #[arg(long)]
    pub keyposes: bool,
}

/// What is measured unless another is named.
pub(crate) const DEFAULT_WEIGHTS: &str = "weights/tiago_dual.safetensors";

/// The file of the tensors, of either name.
fn tensors(text: &str) -> Result<PathBuf, String> {
    Ok(PathBuf::from(if text.ends_with(".safetensors") { text.to_owned() } else { format!("{text}.safetensors") }))
}

fn calibration(text: &str) -> Result<CalibrationMode, String> {
    CalibrationMode::among(text, &CalibrationMode::ALL)
}

/// Where limb rotations are compared.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Frame {
    /// Relative to the chest.
    Chest,
    /// In space.
    Global,
}

impl Frame {
    /// Name on the command line.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Chest => "chest",
            Self::Global => "global",
        }
    }
}
