//! The command line.

use super::output::Format;
use clap::{Parser, ValueEnum};
use config::RobotChoice;
use motion::{CalibrationMode, LoadOptions};
use poses::retargeted::Rate;
use std::path::PathBuf;

/// Bounds of the output rate, Hz: from one posture per second to ten times the control rate.
const RATE_HZ: [f64; 2] = [1.0, 15_000.0];

/// Source of a posture before refinement.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum Method {
    /// Through the shared latent space.
    #[default]
    Network,
    /// By geometry.
    ClosedForm,
}

/// Retargets a folder of motion files to joint trajectories.
///
/// Without --certified they are postures, not a motion: they know no limit of speed and no clearance. Finished files are skipped. A manifest in the output folder records the input and the options of each file.
#[derive(Clone, Debug, Parser)]
#[command(name = "batch", version)]
pub struct Cli {
    /// Folder of motion files: .bvh, HumanML3D .npy, AMASS .npz.
    #[arg(long, value_name = "DIR")]
    pub input: PathBuf,
    /// Output folder of the trajectories.
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// The robot: a name of config/robots, or a robot file.
    #[arg(long, value_name = "NAME|FILE", default_value = "tiago_dual")]
    pub robot: RobotChoice,
    /// Weights, without extension [default: those with the robot's name in weights, or weights/tiago_dual]. Not read
    /// with --method closed-form.
    #[arg(long, value_name = "FILE")]
    pub weights: Option<PathBuf>,
    /// csv: time_s and a column for each joint. npz: q (N, joints), joints, time_s, frame_rate_hz.
    #[arg(long, value_enum, default_value_t)]
    pub format: Format,
    /// Postures per second: source (one for each frame), or a number in Hz, such as 1500 for the control rate.
    #[arg(long, default_value = "source", value_name = "source|HZ", value_parser = rate)]
    pub rate: Rate,
    /// Source of a posture before refinement.
    #[arg(long, value_enum, default_value_t)]
    pub method: Method,
    /// Levenberg-Marquardt steps of the refinement.
    #[arg(long, default_value_t = 2, value_parser = clap::value_parser!(u32).range(0..=i64::from(retarget::REFINEMENT_STEPS_MAX)))]
    pub refine_steps: u32,
    /// Source of the elbow hinges. Use none for motions without rotations.
    #[arg(long, value_name = "clip|first-10s|none", default_value = "clip", value_parser = calibration)]
    pub calibration: CalibrationMode,
    /// Number of files processed at once [default: all cores].
    #[arg(long, value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub jobs: Option<u16>,
    /// Also read folders inside the input. The output has the same folders.
    #[arg(long)]
    pub recursive: bool,
    /// Skip finished files (this is the default).
    #[arg(long, conflicts_with = "overwrite")]
    pub resume: bool,
    /// Make every file again, and replace files that this tool did not write.
    #[arg(long)]
    pub overwrite: bool,
    /// Write what the robot may do: every command at 1500 Hz after whole-body control and the safety gate, from its start to
    /// its end at rest.
    #[arg(long, alias = "safe", conflicts_with_all = ["rate", "method", "refine_steps", "weights"])]
    pub certified: bool,
    /// Settings of --certified.
    #[arg(long, value_name = "FILE", default_value_os_t = instance::default_config())]
    pub config: PathBuf,
    #[command(flatten)]
    pub load: LoadOptions,
}

impl Cli {
    /// Returns the weights, without extension.
    pub fn weights(&self) -> PathBuf {
        self.weights.clone().unwrap_or_else(|| self.robot.shipped_weights())
    }

    /// Returns the number of threads.
    pub fn threads(&self) -> usize {
        self.jobs.map_or_else(|| std::thread::available_parallelism().map_or(1, usize::from), usize::from)
    }
}

fn rate(text: &str) -> Result<Rate, String> {
    if text == "source" {
        return Ok(Rate::Source);
    }
    let [low, high] = RATE_HZ;
    match text.parse::<f64>() {
        Ok(hz) if (low..=high).contains(&hz) => Ok(Rate::Hz(hz)),
        _ => Err(format!("is source or a rate within [{low}, {high}] Hz")),
    }
}

fn calibration(text: &str) -> Result<CalibrationMode, String> {
    CalibrationMode::among(text, &[CalibrationMode::Clip, CalibrationMode::First10s, CalibrationMode::None])
}
