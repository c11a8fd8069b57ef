//! The network's loss and its training by Adam.

use super::people::People;
use super::view::{Errors, View, draw};
use crate::fit::Fit;
use layouts::{DIRECTIONS, LIFTER_INPUTS, LIFTER_OUTPUTS, LIFTER_WIDTHS};
use nalgebra::Vector3;
use rand_pcg::Pcg64;

/// Weights of the directions: arms, hands, trunk.
const WEIGHT: [f64; DIRECTIONS] = [1.0, 1.0, 1.0, 1.0, 0.3, 0.3, 0.4, 0.4];
/// Weights of the likelihood and of the chord. The chord keeps hopeless images from ruling.
const LIKELIHOOD: f64 = 0.5;
const CHORD: f64 = 2.0;
/// Range of the concentration.
const CONCENTRATION: [f64; 2] = [0.05, 300.0];
/// Peak learning rate (found on the validation people).
const RATE: f64 = 1e-3;

/// Returns the loss of one image, and writes its gradient with respect to the outputs, times `scale`.
///
/// ```text
/// L = sum w (0.5 (-ln k - k (c - 1) + ln(1 - e^(-2 k))) + 2 sqrt(2 - 2 c)),   c = d . truth
/// ```
///
/// This is the density of von Mises and Fisher up to a constant, and the chord between direction and truth.
pub fn loss(
    outputs: &[f32],
    truth: &[Vector3<f64>; DIRECTIONS],
    scale: f64,
    gradient: &mut [f32],
) -> (f64, [f64; DIRECTIONS]) {
    let (mut sum, mut degrees) = (0.0, [0.0; DIRECTIONS]);
    for (i, (row, out)) in outputs.as_chunks::<4>().0.iter().zip(gradient.as_chunks_mut::<4>().0).enumerate() {
        let y = Vector3::new(row[0], row[1], row[2]).map(f64::from);
        let length = y.norm().max(1e-6);
        let d = y / length;
        let c = d.dot(&truth[i]).clamp(-1.0, 1.0);
        let raw = f64::from(row[3]) + 2.0;
        let free = if raw > 30.0 { raw } else { raw.exp().ln_1p() };
        let k = free.clamp(CONCENTRATION[0], CONCENTRATION[1]);
        let gone = (-2.0 * k).exp();
        let chord = (2.0 - 2.0 * c).max(1e-6).sqrt();
        sum += WEIGHT[i] * (LIKELIHOOD * (-k.ln() - k * (c - 1.0) + (-gone).ln_1p()) + CHORD * chord);
        let by_c = WEIGHT[i] * (-LIKELIHOOD * k - CHORD / chord);
        let by_y = (truth[i] - d * c) * (by_c / length);
        let by_k = WEIGHT[i] * LIKELIHOOD * (-1.0 / k - (c - 1.0) + 2.0 * gone / (1.0 - gone));
        let by_raw = if free == k { by_k / (1.0 + (-raw).exp()) } else { 0.0 };
        *out = [by_y.x, by_y.y, by_y.z, by_raw].map(|value| (value * scale) as f32);
        degrees[i] = c.acos().to_degrees();
    }
    (sum, degrees)
}

/// Begins a run.
pub fn begin(steps: u64, seed: u64) -> Fit {
    Fit::new(&LIFTER_WIDTHS, RATE, steps, seed)
}

/// Takes one step. Returns the mean angle of the arms in its batch, degrees.
pub fn step(fit: &mut Fit, people: &People, real: Option<&Errors>) -> f64 {
    let drawn = |rng: &mut Pcg64, inputs: &mut [f32]| -> Vec<View> {
        let views = inputs.chunks_exact_mut(LIFTER_INPUTS).map(|input| {
            let view = draw(people, real, rng);
            input.copy_from_slice(&view.inputs);
            view
        });
        views.collect()
    };
    fit.step(drawn, |views, outputs, by_output| {
        let outputs = outputs.chunks_exact(LIFTER_OUTPUTS).zip(by_output.chunks_exact_mut(LIFTER_OUTPUTS));
        let degrees = views.iter().zip(outputs).map(|(view, (output, by))| {
            let (_, degrees) = loss(output, &view.directions, 1.0 / views.len() as f64, by);
            degrees[..4].iter().sum::<f64>() / 4.0
        });
        degrees.sum::<f64>() / views.len() as f64
    })
}
