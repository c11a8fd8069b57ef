//! Predicts a person's motion, learnt from recorded motion. A perceptron maps the turns of an arm's limbs over the last half
//! second to those over the next one. See `retarget::Prediction` for inputs and outputs.

mod data;
mod fit;
mod judge;

pub use data::{Recording, Row, rows};
pub use fit::PredictionFit;
pub use judge::{CONDITIONS, Condition, JUDGED_S, Means, judge};

use crate::clips::Clips;
use crate::files::write_both;
use crate::session::diverged;
use retarget::{Prediction, PredictionManifest};
use rt::{Exit, Failure};
use std::path::Path;

/// Steps between two lines of the report.
const REPORT_STEPS: u64 = 1_000;

/// Learns from the training clips, writes `<out>.safetensors` and `<out>.toml`, and prints the validation.
pub fn learn(out: &Path, clips: &Clips, steps: u64, seed: u64, calibration: &str) -> Result<(), Failure> {
    let recordings: Vec<Recording> = clips.training.iter().map(Recording::new).collect();
    let unknown: Vec<Recording> = clips.validation.iter().map(Recording::new).collect();
    let mut fit = PredictionFit::new(&recordings, steps, seed).ok_or_else(|| diverged(0))?;
    for step in 1..=steps {
        let loss = fit.step();
        if !loss.is_finite() {
            return Err(diverged(step));
        }
        if step.is_multiple_of(REPORT_STEPS) && step < steps {
            let [.., learnt_deg] = judge(&unknown, &fit.prediction(), &CONDITIONS[0]).deg;
            println!("step {step:>7} loss {loss:.3} | {learnt_deg:.2?} deg after {JUDGED_S:?} s");
        }
    }
    let prediction = fit.prediction();
    let (clips, seconds) = (recordings.len(), recordings.iter().map(Recording::end_s).sum::<f64>());
    let trained_on =
        format!("{clips} recorded clips ({seconds:.0} s, hinges calibrated by {calibration}) at 20 to 240 Hz");
    let mut manifest = PredictionManifest { seed, steps, trained_on, ..PredictionManifest::default() };
    for condition in CONDITIONS {
        let means = judge(&unknown, &prediction, &condition);
        manifest.validation.insert(condition.name.into(), means.table().into());
    }
    manifest.validation.insert("clips".into(), toml::Value::Integer(unknown.len() as i64));
    let (tensors, manifest) = Prediction::write(&fit.layers(), &manifest).map_err(Failure::with(Exit::Software))?;
    write_both(out, &tensors, &manifest)?;
    print!("{manifest}");
    println!("wrote {}.safetensors and .toml", out.display());
    Ok(())
}
