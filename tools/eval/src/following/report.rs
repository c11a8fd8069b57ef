//! The table as text, and the same as JSON.

use super::expectation::AHEAD_MS;
use super::judge::{ClipFigures, mean};
use ::report::table::{self, Column, column, number};
use serde_json::{Map, Value, json};
use std::fmt;

#[derive(Clone, Debug)]
pub struct Report {
    pub folder: String,
    pub config: String,
    pub delay_ms: f64,
    pub delays_ms: Vec<f64>,
    pub clips: Vec<ClipFigures>,
    pub skipped: Vec<(String, String)>,
}

impl Report {
    fn numbers(&self, clip: &ClipFigures) -> Value {
        let at = self.delays_ms.iter().zip(&clip.at_deg).map(|(ms, deg)| (ms.to_string(), json!(deg)));
        let expected = AHEAD_MS.iter().zip(&clip.expected_deg).map(|(ms, deg)| (ms.to_string(), json!(deg)));
        let at_delay =
            self.delays_ms.iter().position(|ms| *ms == self.delay_ms).and_then(|i| clip.at_deg.get(i).copied());
        let mut row = json!(clip);
        row["at_ms_deg"] = at.collect::<Map<_, _>>().into();
        row["at_delay_deg"] = json!(at_delay);
        row["expected_ms_deg"] = expected.collect::<Map<_, _>>().into();
        row
    }

    fn summaries(&self) -> [(&'static str, Value); 2] {
        let rows: Vec<Value> = self.clips.iter().map(|clip| self.numbers(clip)).collect();
        // Without a clip, the numbers of an empty one name the columns.
        let like = rows.first().cloned().unwrap_or_else(|| self.numbers(&ClipFigures::default()));
        let rows: Vec<&Value> = rows.iter().collect();
        [("mean", summary(&like, &rows, mean)), ("median", summary(&like, &rows, median))]
    }

    pub fn json(&self) -> Value {
        let clips = self.clips.iter().map(|clip| {
            let mut value = self.numbers(clip);
            value["clip"] = json!(clip.name);
            value["violations"] = json!(clip.violations);
            value["stopped"] = json!(clip.stopped);
            value
        });
        let [(_, mean), (_, median)] = self.summaries();
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

    fn columns(&self) -> Vec<Column<'_, (Value, u64)>> {
        let figure = |head: &str, width, digits, key: &'static str| {
            column(["", head], width, move |(row, _): &(Value, u64)| number(row[key].as_f64(), digits))
        };
        let mut columns = vec![figure("s", 6, 1, "seconds"), figure("now", 6, 1, "now_deg")];
        columns.extend(self.delays_ms.iter().map(|ms| {
            let text = move |(row, _): &(Value, u64)| number(row["at_ms_deg"][ms.to_string()].as_f64(), 1);
            column(["", &format!("{ms} ms")], 7, text)
        }));
        let percent = |share: &Value| number(share.as_f64().map(|share| 100.0 * share), 1) + " %";
        columns.extend([
            figure("best", 6, 1, "best_deg"),
            figure("at ms", 5, 0, "best_ms"),
            column(["", "free"], 7, move |(row, _): &(Value, u64)| percent(&row["hands_free"])),
            figure("hands", 6, 1, "hands_deg"),
            figure("known", 6, 1, "hands_known_deg"),
            figure("opt.", 5, 1, "hands_optimum_deg"),
            figure("torque", 7, 2, "torque_share_max"),
            column(["", "on plan"], 8, move |(row, _): &(Value, u64)| percent(&row["on_plan_share"])),
            column(["", "viol."], 6, |(_, violations): &(Value, u64)| violations.to_string()),
        ]);
        columns
    }
}

/// Combines each number of the rows by `of`. `like` has the keys.
fn summary(like: &Value, rows: &[&Value], of: fn(&[f64]) -> Option<f64>) -> Value {
    let Value::Object(keys) = like else {
        return json!(of(&rows.iter().filter_map(|value| value.as_f64()).collect::<Vec<_>>()));
    };
    let one = |(key, like): (&String, &Value)| {
        let values: Vec<&Value> = rows.iter().map(|row| &row[key]).collect();
        (key.clone(), summary(like, &values, of))
    };
    Value::Object(keys.iter().map(one).collect())
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
        let clips = self.clips.iter().map(|clip| (clip.name.as_str(), self.numbers(clip), clip.violations_total()));
        let all = self.clips.iter().map(ClipFigures::violations_total).sum();
        let summaries = self.summaries();
        let [(_, mean), (_, median)] = &summaries;
        let summaries = summaries.iter().map(|(name, row)| (*name, row.clone(), all));
        let rows: Vec<_> = clips.chain(summaries).map(|(name, row, count)| (name, (row, count))).collect();
        table::write(f, ("degrees", 20), &self.columns(), rows.iter().map(|(name, row)| (*name, row)))?;
        for clip in &self.clips {
            if let Some(why) = &clip.stopped {
                writeln!(f, "{}: {why}", clip.name)?;
            }
        }
        for (clip, why) in &self.skipped {
            writeln!(f, "not judged: {clip}: {why}")?;
        }
        writeln!(
            f,
            "{} clips of {}, settings {}\n\
             command against person while Engaged, mean angle of four limbs, every 20 ms, at recorded speed\n\
             hands: those that the robot could take without coming near anything (free), against the person of the following\n\
             delay before; known: the best of wrists that know the hand so far ahead; opt.: of wrists that know all",
            self.clips.len(),
            self.folder,
            self.config
        )?;
        let ahead = AHEAD_MS.map(|ms| {
            let [mean, median] = [mean, median].map(|row| number(row["expected_ms_deg"][ms.to_string()].as_f64(), 1));
            format!(" {ms} ms {mean} (median {median})")
        });
        let ahead = ahead.join(",");
        writeln!(f, "the person against the prediction, at these times after the newest skeleton:{ahead}")
    }
}
