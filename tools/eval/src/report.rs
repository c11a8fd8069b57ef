//! The table as text, and the same as JSON.

use crate::cli::Cli;
use crate::methods::{Missing, SECOND_STARTS};
use crate::metrics::{Figures, Task};
use retarget::Weights;
use serde_json::{Map, Value, json};
use std::fmt;
use std::path::Path;

/// Measurements of a method.
#[derive(Clone, Debug)]
pub struct Measured {
    /// Error and smoothness.
    pub figures: Figures,
    /// Microseconds per pose.
    pub us_per_pose: Option<f64>,
    /// Training data of a learned baseline.
    pub trained_on: Option<String>,
}

/// A method and its figures.
#[derive(Clone, Debug)]
pub struct Row {
    /// Name.
    pub name: String,
    /// Figures, or the reason why there are none.
    pub result: Result<Measured, Missing>,
}

/// Conditions of the measurement.
#[derive(Clone, Debug)]
pub struct Setting {
    /// Folder of the clips.
    pub human: String,
    /// Names of the clips.
    pub clips: Vec<String>,
    /// Frames, both arms each.
    pub frames: usize,
    /// Stride of the measured frames.
    pub stride: usize,
    /// Calibration of the hinges.
    pub calibration: &'static str,
    /// Frame in which rotations were compared.
    pub frame: &'static str,
    /// Our weights.
    pub weights: Option<WeightsFacts>,
}

/// Facts about our weights.
#[derive(Clone, Debug)]
pub struct WeightsFacts {
    /// File of the weights.
    pub path: String,
    /// SHA-256.
    pub sha256: String,
    /// Steps of the training.
    pub steps: u64,
    /// Training data of the weights.
    pub trained_on: String,
}

/// All measurements.
#[derive(Clone, Debug)]
pub struct Report {
    /// Methods in the order of the table.
    pub rows: Vec<Row>,
    /// The second oracle, measured against the first.
    pub floor: Figures,
    /// Conditions of the measurement.
    pub setting: Setting,
}

impl Setting {
    /// Creates the conditions of a run.
    #[must_use]
    pub fn of(cli: &Cli, human: &Path, weights: Option<&Weights>, tasks: &[Task]) -> Self {
        Self {
            human: human.display().to_string(),
            clips: tasks.iter().map(|task| task.clip.name.clone()).collect(),
            frames: tasks.iter().map(|task| task.clip.human.len()).sum(),
            stride: cli.stride,
            calibration: cli.calibration.name(),
            frame: cli.frame.name(),
            weights: weights.map(|weights| WeightsFacts {
                path: cli.weights.display().to_string(),
                sha256: weights.manifest.sha256.clone(),
                steps: weights.manifest.steps,
                trained_on: weights.manifest.trained_on.clone(),
            }),
        }
    }
}

/// Formats a figure in `width` columns, or a dash.
pub(crate) fn cell(value: Option<f64>, width: usize, digits: usize) -> String {
    match value {
        Some(value) if value.is_finite() => format!("{value:>width$.digits$}"),
        _ => format!("{:>width$}", "-"),
    }
}

/// Formats microseconds. A repetition gives no more than three digits.
fn time_cell(value: Option<f64>) -> String {
    cell(value, 8, if value.is_some_and(|value| value >= 100.0) { 0 } else { 2 })
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "{:<18} {:>7} {:>7} {:>7} {:>7} {:>8} {:>7} {:>6} {:>8} {:>7} {:>7}",
            "", "S_GR", "limb", "limb", "bones", "joints", "jerk", "flips", "time", "reach.", "reach."
        )?;
        writeln!(
            f,
            "{:<18} {:>7} {:>7} {:>7} {:>7} {:>8} {:>7} {:>6} {:>8} {:>7} {:>7}",
            "method", "", "deg", "p95", "deg", "rad^2", "ratio", "/1000", "us", "deg", "p99"
        )?;
        for row in &self.rows {
            let Ok(Measured { figures, us_per_pose, .. }) = &row.result else { continue };
            write!(f, "{:<18} {} ", row.name, cell(Some(figures.s_gr), 7, 4))?;
            write!(f, "{} ", cell(Some(figures.limb_deg_mean), 7, 2))?;
            write!(f, "{} ", cell(Some(figures.limb_deg_p95), 7, 2))?;
            write!(f, "{} ", cell(Some(figures.direction_deg), 7, 2))?;
            write!(f, "{} ", cell(figures.joint_mse_rad2, 8, 4))?;
            write!(f, "{} ", cell(figures.jerk_ratio, 7, 2))?;
            write!(f, "{} ", cell(figures.flips_per_1000, 6, 2))?;
            write!(f, "{} ", time_cell(*us_per_pose))?;
            write!(f, "{} ", cell(figures.reachable_deg_mean, 7, 2))?;
            writeln!(f, "{}", cell(figures.reachable_deg_p99, 7, 2))?;
        }
        self.notes(f)
    }
}

impl Report {
    /// Returns the figures of a method, if measured.
    #[must_use]
    pub fn figures(&self, name: &str) -> Option<&Figures> {
        let row = self.rows.iter().find(|row| row.name == name)?;
        row.result.as_ref().ok().map(|measured| &measured.figures)
    }

    fn notes(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (setting, floor) = (&self.setting, &self.floor);
        writeln!(
            f,
            "\nfloor: an oracle of {SECOND_STARTS} random starts alone differs by {:.1e} rad^2 ({:.1e} with the frames near the gimbal)",
            floor.joint_mse_rad2.unwrap_or(f64::NAN),
            floor.joint_mse_all_rad2.unwrap_or(f64::NAN),
        )?;
        writeln!(
            f,
            "reachable (oracle below 2 degrees in both limbs): {:.1} % of the frames of an arm",
            100.0 * floor.reachable_share
        )?;
        let missing: Vec<_> = self.rows.iter().filter_map(|row| row.result.as_ref().err().map(|m| (row, m))).collect();
        for (row, missing) in missing {
            writeln!(f, "missing {}: {}", row.name, missing.command)?;
        }
        let mut trained: Vec<(&str, Vec<&str>)> = Vec::new();
        for row in &self.rows {
            if let Ok(Measured { trained_on: Some(trained_on), .. }) = &row.result {
                match trained.iter_mut().find(|(text, _)| text == trained_on) {
                    Some((_, names)) => names.push(&row.name),
                    None => trained.push((trained_on, vec![&row.name])),
                }
            }
        }
        for (text, names) in trained {
            writeln!(f, "{}: {text}", names.join(", "))?;
        }
        writeln!(f, "{} clips of {}: {}", setting.clips.len(), setting.human, setting.clips.join(" "))?;
        writeln!(
            f,
            "{} frames of both arms{}; hinges calibrated on: {}; rotations compared in: {}",
            setting.frames,
            if setting.stride == 1 { String::new() } else { format!(", every {}-th", setting.stride) },
            setting.calibration,
            setting.frame
        )?;
        match &setting.weights {
            None => writeln!(f, "weights: none")?,
            Some(weights) => {
                let sha = weights.sha256.get(..12).unwrap_or(&weights.sha256);
                writeln!(
                    f,
                    "weights {} (sha256 {sha}), {} steps on {}",
                    weights.path, weights.steps, weights.trained_on
                )?;
            }
        }
        writeln!(f, "time: both arms, batch 1, median over repetitions in this run on this machine")?;
        writeln!(
            f,
            "jerk: RMS third difference of the joints over the oracle's, between jumps; joints: MSE to the oracle's"
        )?;
        writeln!(
            f,
            "flips: a joint moves over 30 degrees in a frame, the human's limbs under 5; per 1000 frames of an arm"
        )
    }

    /// Returns the table as JSON.
    #[must_use]
    pub fn json(&self) -> Value {
        let mut methods = Map::new();
        let mut missing = Map::new();
        for row in &self.rows {
            match &row.result {
                Ok(measured) => methods.insert(row.name.clone(), measured_json(measured)),
                Err(reason) => {
                    missing.insert(row.name.clone(), json!({"reason": reason.reason, "command": reason.command}))
                }
            };
        }
        let setting = &self.setting;
        json!({
            "human": setting.human,
            "clips": setting.clips,
            "frames": setting.frames,
            "stride": setting.stride,
            "calibration": setting.calibration,
            "frame": setting.frame,
            "weights": setting.weights.as_ref().map(|weights| json!({
                "path": weights.path,
                "sha256": weights.sha256,
                "steps": weights.steps,
                "trained_on": weights.trained_on,
            })),
            "methods": methods,
            "missing": missing,
            "floor": {
                "joint_mse_rad2": self.floor.joint_mse_rad2,
                "joint_mse_all_rad2": self.floor.joint_mse_all_rad2,
                "jerk_ratio": self.floor.jerk_ratio,
            },
            "reachable_share": self.floor.reachable_share,
        })
    }
}

fn measured_json(Measured { figures, us_per_pose, trained_on }: &Measured) -> Value {
    json!({
        "trained_on": trained_on,
        "s_gr": figures.s_gr,
        "limb_deg_mean": figures.limb_deg_mean,
        "limb_deg_p95": figures.limb_deg_p95,
        "direction_deg": figures.direction_deg,
        "joint_mse_rad2": figures.joint_mse_rad2,
        "joint_mse_all_rad2": figures.joint_mse_all_rad2,
        "jerk_ratio": figures.jerk_ratio,
        "jerk_ratio_with_jumps": figures.jerk_ratio_with_jumps,
        "flips_per_1000": figures.flips_per_1000,
        "us_per_pose": us_per_pose,
        "reachable_deg_mean": figures.reachable_deg_mean,
        "reachable_deg_p99": figures.reachable_deg_p99,
        "by_limb_deg": figures.by_limb_deg,
    })
}
