//! The command line.

use clap::{Parser, ValueEnum};
use motion::CalibrationMode;
use std::path::PathBuf;

/// Measures retargeting methods side by side on recorded motion: how near they come to the human, to the best that the
/// arm can do, how smooth they are and how long they take.
#[derive(Clone, Debug, Parser)]
#[command(name = "eval", version)]
pub struct Cli {
    /// Folder of motion files
    #[arg(long, value_name = "DIR")]
    pub human: PathBuf,
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
    /// out; all if there are fewer than five]
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
    /// Draw the figures as SVG files into this folder
    #[arg(long, value_name = "DIR")]
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
