//! The table as text, and the same as JSON.

use crate::cli::Cli;
use crate::methods::Missing;
use crate::metrics::{MethodFigures, Task};
use ::report::table::{self, column, number};
use retarget::Weights;
use serde::Serialize;
use serde_json::{Map, Value, json};
use std::fmt;
use std::path::Path;

#[derive(Clone, Debug, Serialize)]
pub struct Measured {
    #[serde(flatten)]
    pub figures: MethodFigures,
    pub us_per_pose: Option<f64>,
}

#[derive(Clone, Debug, Serialize)]
pub struct Setting {
    pub human: String,
    pub clips: Vec<String>,
    pub frames: usize,
    pub calibration: &'static str,
    pub weights: Option<WeightsFacts>,
}

#[derive(Clone, Debug, Serialize)]
pub struct WeightsFacts {
    pub path: String,
    pub sha256: String,
    pub steps: u64,
    pub trained_on: String,
}

#[derive(Clone, Debug)]
pub struct Report {
    pub rows: Vec<(String, Result<Measured, Missing>)>,
    pub setting: Setting,
}

impl Setting {
    pub fn new(cli: &Cli, human: &Path, weights: Option<&Weights>, tasks: &[Task]) -> Self {
        Self {
            human: human.display().to_string(),
            clips: tasks.iter().map(|task| task.clip.name.clone()).collect(),
            frames: tasks.iter().map(|task| task.clip.human.len()).sum(),
            calibration: cli.calibration.name(),
            weights: weights.map(|weights| WeightsFacts {
                path: cli.weights().0.display().to_string(),
                sha256: weights.manifest.sha256.clone(),
                steps: weights.manifest.steps,
                trained_on: weights.manifest.trained_on.clone(),
            }),
        }
    }
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let figure = |head, width, digits, value: fn(&MethodFigures) -> Option<f64>| {
            column(head, width, move |row: &Measured| number(value(&row.figures), digits))
        };
        // A repetition gives no more than three digits of the time.
        let time = |row: &Measured| number(row.us_per_pose, if row.us_per_pose >= Some(100.0) { 0 } else { 2 });
        let columns = [
            figure(["S_GR", ""], 7, 4, |row| Some(row.s_gr)),
            figure(["limb", "deg"], 7, 2, |row| Some(row.limb_deg_mean)),
            figure(["limb", "p95"], 7, 2, |row| Some(row.limb_deg_p95)),
            figure(["bones", "deg"], 7, 2, |row| Some(row.direction_deg)),
            figure(["joints", "rad^2"], 8, 4, |row| row.joint_mse_rad2),
            figure(["jerk", "ratio"], 7, 2, |row| row.jerk_ratio),
            figure(["flips", "/1000"], 6, 2, |row| row.flips_per_1000),
            column(["time", "us"], 8, time),
            figure(["reach.", "deg"], 7, 2, |row| row.reachable_deg_mean),
            figure(["reach.", "p99"], 7, 2, |row| row.reachable_deg_p99),
        ];
        table::write(f, ("method", 18), &columns, self.measured())?;
        self.notes(f)
    }
}

impl Report {
    fn measured(&self) -> impl Iterator<Item = (&str, &Measured)> {
        self.rows.iter().filter_map(|(name, result)| Some((name.as_str(), result.as_ref().ok()?)))
    }

    fn missing(&self) -> impl Iterator<Item = (&str, &Missing)> {
        self.rows.iter().filter_map(|(name, result)| Some((name.as_str(), result.as_ref().err()?)))
    }

    pub fn figures(&self, name: &str) -> Option<&MethodFigures> {
        self.measured().find(|(known, _)| *known == name).map(|(_, measured)| &measured.figures)
    }

    /// Returns the share of reachable frames. It depends on the oracle alone, so it is the same for all methods.
    fn reachable_share(&self) -> Option<f64> {
        self.measured().next().map(|(_, measured)| measured.figures.reachable_share)
    }

    fn notes(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let setting = &self.setting;
        writeln!(
            f,
            "\nreachable (oracle below 2 degrees in both limbs): {} % of the frames of an arm",
            number(self.reachable_share().map(|share| 100.0 * share), 1)
        )?;
        for (name, missing) in self.missing() {
            writeln!(f, "missing {name}: {}", missing.command)?;
        }
        writeln!(f, "{} clips of {}: {}", setting.clips.len(), setting.human, setting.clips.join(" "))?;
        writeln!(f, "{} frames of both arms; hinges calibrated on: {}", setting.frames, setting.calibration)?;
        match &setting.weights {
            None => writeln!(f, "weights: none")?,
            Some(WeightsFacts { path, sha256, steps, trained_on }) => {
                let sha = sha256.get(..12).unwrap_or(sha256);
                writeln!(f, "weights {path} (sha256 {sha}), {steps} steps on {trained_on}")?;
            }
        }
        f.write_str(
            "time: both arms, batch 1, median over repetitions in this run on this machine\n\
             jerk: RMS third difference of the joints over the oracle's, between jumps; joints: MSE to the oracle's\n\
             flips: a joint moves over 30 degrees in a frame, the human's limbs under 5; per 1000 frames of an arm\n",
        )
    }

    pub fn json(&self) -> Value {
        let mut out = json!(self.setting);
        let methods = self.measured().map(|(name, measured)| (name.to_owned(), json!(measured)));
        out["methods"] = methods.collect::<Map<_, _>>().into();
        let missing = self.missing().map(|(name, missing)| (name.to_owned(), json!(missing)));
        out["missing"] = missing.collect::<Map<_, _>>().into();
        out["reachable_share"] = json!(self.reachable_share());
        out
    }
}
