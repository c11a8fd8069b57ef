//! The table as text, and the same as JSON.

use super::ahead::AHEAD_MS;
use super::judge::{Figures, mean};
use crate::report::cell;
use serde_json::{Map, Value, json};
use std::fmt;

/// All measurements.
#[derive(Clone, Debug)]
pub struct Report {
    /// The folder.
    pub folder: String,
    /// The settings file.
    pub config: String,
    /// Delay of the ratios, ms.
    pub delay_ms: f64,
    /// All delays, ms.
    pub delays_ms: Vec<f64>,
    /// The clips that were judged.
    pub clips: Vec<Figures>,
    /// Clips that were not judged, and the reasons.
    pub skipped: Vec<(String, String)>,
}

/// The numbers of a row, in the order of the table.
struct Numbers {
    seconds: f64,
    now: f64,
    at: Vec<f64>,
    best: f64,
    best_ms: f64,
    optimum: Option<f64>,
    squares: Option<f64>,
    ratio: Option<f64>,
    expected: [Option<f64>; AHEAD_MS.len()],
    torque: f64,
    on_plan: f64,
}

impl Report {
    fn numbers(&self, clip: &Figures) -> Numbers {
        let at_delay = self.delays_ms.iter().position(|ms| *ms == self.delay_ms).map(|i| clip.at_deg[i]);
        Numbers {
            seconds: clip.seconds,
            now: clip.now_deg,
            at: clip.at_deg.clone(),
            best: clip.best_deg,
            best_ms: clip.best_ms,
            optimum: clip.optimum_deg,
            squares: clip.least_squares_deg,
            ratio: at_delay.zip(clip.optimum_deg).map(|(at, optimum)| at / optimum),
            expected: clip.expected_deg,
            torque: clip.torque_share_max,
            on_plan: clip.on_plan_share,
        }
    }

    /// Combines each number of all clips by `of`.
    fn summary(&self, of: fn(&[f64]) -> Option<f64>) -> Numbers {
        let rows: Vec<Numbers> = self.clips.iter().map(|clip| self.numbers(clip)).collect();
        let known = |get: &dyn Fn(&Numbers) -> Option<f64>| of(&rows.iter().filter_map(get).collect::<Vec<_>>());
        let all = |get: &dyn Fn(&Numbers) -> f64| known(&|row| Some(get(row))).unwrap_or(f64::NAN);
        Numbers {
            seconds: all(&|row| row.seconds),
            now: all(&|row| row.now),
            at: (0..self.delays_ms.len()).map(|i| all(&|row| row.at[i])).collect(),
            best: all(&|row| row.best),
            best_ms: all(&|row| row.best_ms),
            optimum: known(&|row| row.optimum),
            squares: known(&|row| row.squares),
            ratio: known(&|row| row.ratio),
            expected: std::array::from_fn(|i| known(&|row| row.expected[i])),
            torque: all(&|row| row.torque),
            on_plan: all(&|row| row.on_plan),
        }
    }

    fn summaries(&self) -> [(&'static str, Numbers); 2] {
        [("mean", self.summary(mean)), ("median", self.summary(median))]
    }

    /// Returns the table as JSON.
    #[must_use]
    pub fn json(&self) -> Value {
        let numbers = |row: &Numbers| {
            let at = self.delays_ms.iter().zip(&row.at).map(|(ms, deg)| (format!("{ms}"), json!(deg)));
            let expected = AHEAD_MS.iter().zip(&row.expected).map(|(ms, deg)| (format!("{ms}"), json!(deg)));
            json!({
                "seconds": row.seconds,
                "now_deg": row.now,
                "at_ms_deg": at.collect::<Map<_, _>>(),
                "at_delay_deg": self.delays_ms.iter().position(|ms| *ms == self.delay_ms).map(|i| row.at[i]),
                "best_deg": row.best,
                "best_ms": row.best_ms,
                "optimum_deg": row.optimum,
                "optimum_least_squares_deg": row.squares,
                "ratio": row.ratio,
                "expected_ms_deg": expected.collect::<Map<_, _>>(),
                "torque_share_max": row.torque,
                "on_plan_share": row.on_plan,
            })
        };
        let clips = self.clips.iter().map(|clip| {
            let mut value = numbers(&self.numbers(clip));
            value["clip"] = json!(clip.name);
            value["violations"] = json!(clip.violations);
            value["stopped"] = json!(clip.stopped);
            value
        });
        let [mean, median] = self.summaries().map(|(_, row)| numbers(&row));
        let skipped = self.skipped.iter().map(|(clip, why)| json!({ "clip": clip, "why": why }));
        json!({
            "following": self.folder,
            "config": self.config,
            "delay_ms": self.delay_ms,
            "clips": clips.collect::<Vec<_>>(),
            "mean": mean,
            "median": median,
            "skipped": skipped.collect::<Vec<_>>(),
        })
    }
}

/// Returns the middle value, or the mean of both middle values. None if there are no values.
fn median(values: &[f64]) -> Option<f64> {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let (low, high) = (sorted.get(sorted.len().checked_sub(1)? / 2)?, sorted.get(sorted.len() / 2)?);
    Some((low + high) / 2.0)
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:<20} {:>6} {:>6}", "degrees", "s", "now")?;
        for ms in &self.delays_ms {
            write!(f, " {:>7}", format!("{ms} ms"))?;
        }
        writeln!(
            f,
            " {:>6} {:>5} {:>8} {:>6} {:>7} {:>8} {:>6}",
            "best", "at ms", "optimum", "ratio", "torque", "on plan", "viol."
        )?;
        let row = |f: &mut fmt::Formatter<'_>, name: &str, row: &Numbers, violations: u64| {
            write!(f, "{name:<20} {} {}", cell(Some(row.seconds), 6, 1), cell(Some(row.now), 6, 1))?;
            for at in &row.at {
                write!(f, " {}", cell(Some(*at), 7, 1))?;
            }
            write!(f, " {} {}", cell(Some(row.best), 6, 1), cell(Some(row.best_ms), 5, 0))?;
            write!(f, " {} {}", cell(row.optimum, 8, 1), cell(row.ratio, 6, 2))?;
            write!(f, " {} {} %", cell(Some(row.torque), 7, 2), cell(Some(100.0 * row.on_plan), 6, 1))?;
            writeln!(f, " {violations:>6}")
        };
        for clip in &self.clips {
            row(f, &clip.name, &self.numbers(clip), clip.violations_total())?;
        }
        let violations = self.clips.iter().map(Figures::violations_total).sum();
        for (name, numbers) in self.summaries() {
            row(f, name, &numbers, violations)?;
        }
        for clip in &self.clips {
            if let Some(why) = &clip.stopped {
                writeln!(f, "{}: {why}", clip.name)?;
            }
        }
        for (clip, why) in &self.skipped {
            writeln!(f, "not judged: {clip}: {why}")?;
        }
        writeln!(f, "{} clips of {}, settings {}", self.clips.len(), self.folder, self.config)?;
        writeln!(f, "command against person while Engaged, mean angle of four limbs, every 20 ms, at recorded speed")?;
        writeln!(
            f,
            "ratio: the error at {} ms over the optimum, which looks ahead and knows no collisions",
            self.delay_ms
        )?;
        write!(f, "the person against the prediction, at these times after the newest skeleton:")?;
        let [(_, mean), (_, median)] = self.summaries();
        for (i, ms) in AHEAD_MS.iter().enumerate() {
            let [mean, median] = [&mean, &median].map(|row| cell(row.expected[i], 0, 1));
            write!(f, "{} {ms} ms {mean} (median {median})", if i == 0 { "" } else { "," })?;
        }
        writeln!(f)
    }
}
