//! Predicts a person's motion, learnt from recorded motion. Weighted ridge regression, in closed form, maps the
//! turns of an arm's limbs over the last half second to those over the next one. See `retarget::Prediction` for
//! inputs and outputs.

mod data;
mod fit;
mod judge;

pub use data::{Draw, Recording, draw};
pub use fit::fit;
pub use judge::{CONDITIONS, Condition, JUDGED_S, Means, judge};

use crate::clips::Clips;
use crate::files::write_both;
use crate::session::diverged;
use retarget::PredictionManifest;
use rt::{Exit, Failure};
use std::fmt::Write;
use std::path::Path;

/// Number of draws, each of both arms (assumption: one and a half times the frames of the clips that it was made for).
const DRAWS: usize = 30_000;

/// Learns from the training clips, writes `<out>.safetensors` and `<out>.toml`, and prints the validation.
pub fn learn(out: &Path, clips: &Clips, seed: u64, calibration: &str) -> Result<(), Failure> {
    let recordings: Vec<Recording> = clips.training.iter().map(Recording::new).collect();
    let unknown: Vec<Recording> = clips.validation.iter().map(Recording::new).collect();
    let prediction = fit(&draw(&recordings, DRAWS, seed)).ok_or_else(|| diverged(0))?;
    let trained_on = description(&recordings, calibration);
    let mut manifest = PredictionManifest { seed, trained_on, ..PredictionManifest::default() };
    let mut text = String::new();
    for condition in CONDITIONS {
        let means = judge(&unknown, &prediction, &condition);
        // Writing to a String cannot fail.
        let _ = write!(text, "{means}");
        manifest.validation.insert(condition.name.into(), means.table().into());
    }
    manifest.validation.insert("clips".into(), toml::Value::Integer(unknown.len() as i64));
    let (tensors, manifest) = prediction.write(&manifest).map_err(Failure::with(Exit::Software))?;
    write_both(out, &tensors, &manifest)?;
    print!("{text}");
    println!("wrote {}.safetensors and .toml", out.display());
    Ok(())
}

fn description(recordings: &[Recording], calibration: &str) -> String {
    let seconds: f64 = recordings.iter().map(Recording::end_s).sum();
    format!(
        "{} recorded clips ({seconds:.0} s, hinges calibrated by {calibration}), {DRAWS} draws of both arms at 20 to 240 Hz",
        recordings.len()
    )
}
