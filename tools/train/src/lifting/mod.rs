//! Trains `layouts::Lifter`, which lifts the points of one image to the directions of arms, hands and trunk. People of motion
//! capture are seen by random cameras. First errors of a landmarker are drawn from a formula, then they are those that a real
//! landmarker made on images of people who were turned alike.

mod fit;
mod judge;
mod people;
mod view;

pub use fit::{begin, loss, step};
pub use judge::{Judged, judge};
pub use people::{Pair, Pairs, People, Recorded};
pub use view::{Errors, View, directions, draw};

use crate::files::write_both;
use crate::fit::rounded;
use crate::session::diverged;
use layouts::{Lifter, LifterManifest};
use rt::{Exit, Failure};
use std::path::Path;

/// Share of the steps in which errors come from the formula alone.
const FORMULA_SHARE: f64 = 0.5;
/// Steps between two lines of the report.
const REPORT_STEPS: u64 = 2_000;

/// Learns from `people`, with the errors of `pairs`, and judges on `validation`. Writes `<out>.safetensors` and `<out>.toml`.
pub fn learn(out: &Path, people: &Path, pairs: &Path, validation: &Path, steps: u64, seed: u64) -> Result<(), Failure> {
    let people = People::read(people)?;
    let (errors, unknown) = (Pairs::read(pairs)?, Pairs::read(validation)?);
    println!("{} frames of people, {} images for errors, {} to judge", people.frames(), errors.len(), unknown.len());
    println!("landmarker {}", judge(&unknown, None));
    let bank = Errors::new(&errors);
    let mut fit = begin(steps, seed);
    for done in 0..steps {
        let real = (done as f64 >= FORMULA_SHARE * steps as f64).then_some(&bank);
        let mean_deg = step(&mut fit, &people, real);
        if !mean_deg.is_finite() {
            return Err(diverged(done));
        }
        if (done + 1).is_multiple_of(REPORT_STEPS) || done + 1 == steps {
            println!(
                "step {:>7} training {mean_deg:.2} deg | {}",
                done + 1,
                judge(&unknown, Some(&Lifter::new(&fit.layers())))
            );
        }
    }
    let layers = rounded(fit.layers());
    let manifest = LifterManifest {
        seed,
        steps,
        trained_on: format!(
            "{} frames of motion capture on meshes, in random cameras, with the errors of a landmarker on {} images",
            people.frames(),
            errors.len()
        ),
        validation: judge(&unknown, Some(&Lifter::new(&layers))).table(),
        ..LifterManifest::default()
    };
    let (tensors, manifest) = Lifter::write(&layers, &manifest).map_err(Failure::with(Exit::Software))?;
    write_both(out, &tensors, &manifest)?;
    println!("wrote {}.safetensors and .toml", out.display());
    Ok(())
}
