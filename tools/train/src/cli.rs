//! The command line.

use crate::networks::Size;
use crate::objective::Weighting;
use crate::optimiser::Schedule;
use crate::sampling::Mixture;
use crate::session::Options;
use clap::{Parser, ValueEnum};
use motion::{CalibrationMode, LoadOptions};
use report::out_of_bounds;
use rt::Failure;
use std::path::PathBuf;

/// Trains the shared latent space of one robot's arms from motion files and procedural poses, without labels.
#[derive(Clone, Debug, Parser)]
#[command(name = "train", version)]
pub struct Cli {
    /// Folder of motion files with rotations. Every fifth file, starting with the third, is kept for validation. Of further
    /// folders, separated by commas, all files are trained on
    #[arg(long, value_name = "DIR", value_delimiter = ',', required = true)]
    pub human: Vec<PathBuf>,
    /// Robot file. --prediction does not use it. Several, separated by commas, get one human encoder and one latent
    /// space
    #[arg(long, visible_alias = "robots", value_name = "FILE", value_delimiter = ',')]
    #[arg(default_value = "config/robots/tiago_dual.toml")]
    pub robot: Vec<PathBuf>,
    /// Output path of the weights: OUT.safetensors and OUT.toml. For several robots it is a folder of one file
    /// for each name
    #[arg(long, value_name = "OUT")]
    pub out: PathBuf,
    /// Train the prediction of a person's arm motion instead, from the same clips. Takes minutes
    #[arg(long, conflicts_with_all = ["preset", "batch", "rate"])]
    pub prediction: bool,
    /// Train the lifter of a camera's image points instead. --human is then the file of `tools/camera/render points`
    #[arg(long, requires_all = ["pairs", "validation"], conflicts_with_all = ["prediction", "preset", "batch", "rate"])]
    pub lifter: bool,
    /// Folder of `tools/camera/render pairs`, whose errors --lifter learns
    #[arg(long, value_name = "DIR")]
    pub pairs: Option<PathBuf>,
    /// The same of other people, on whom --lifter is judged
    #[arg(long, value_name = "DIR")]
    pub validation: Option<PathBuf>,
    /// Length of the training
    #[arg(long, value_enum, default_value = "full")]
    pub preset: Preset,
    /// Number of steps, 1 to 10000000, instead of the preset's
    #[arg(long, value_parser = clap::value_parser!(u64).range(1..=10_000_000))]
    pub steps: Option<u64>,
    /// Seed of weights and poses, and of the draws of --prediction
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Poses per step, an even number, instead of the preset's
    #[arg(long)]
    pub batch: Option<usize>,
    /// Peak learning rate of Adam, instead of the preset's
    #[arg(long, value_parser = rt::number, allow_negative_numbers = true)]
    pub rate: Option<f64>,
    /// Part of each clip in which the elbow hinges are estimated
    #[arg(long, value_name = "clip|first-10s", default_value = "first-10s", value_parser = calibration)]
    pub calibration: CalibrationMode,
    #[command(flatten)]
    pub load: LoadOptions,
}

/// Length of a training.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Preset {
    /// Minutes, for a first look
    Quick,
    /// As the shipped weights
    Full,
}

fn calibration(text: &str) -> Result<CalibrationMode, String> {
    CalibrationMode::among(text, &[CalibrationMode::Clip, CalibrationMode::First10s])
}

impl Cli {
    /// Returns the options of a new run.
    pub fn options(&self) -> Result<Options, Failure> {
        let steps = self.steps.unwrap_or(match self.preset {
            Preset::Quick => 6_000,
            Preset::Full => 80_000,
        });
        // Batch, rate and decay: `weights/EXPERIMENTS.md`.
        let (batch, rate) = (self.batch.unwrap_or(256), self.rate.unwrap_or(4e-3));
        if batch < 4 || !batch.is_multiple_of(2) || batch > 65_536 {
            return Err(out_of_bounds("--batch", batch, "an even number from 4 to 65536"));
        }
        if !(rate > 0.0 && rate <= 0.1) {
            return Err(out_of_bounds("--rate", rate, "above 0, at most 0.1"));
        }
        Ok(Options {
            size: Size { hidden_layers: 6, hidden_width: 128 },
            batch,
            schedule: Schedule { peak: rate, warm_up: 500.min(steps / 4), second_decay: 0.99, steps },
            seed: self.seed,
            weighting: Weighting::OURS,
            mixture: Mixture::default(),
        })
    }
}
