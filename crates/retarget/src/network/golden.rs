//! Self-test of the networks: 64 fixed inputs are compared with a plain sum in f64. The test runs the code for
//! this processor's vectors, on this processor, with the loaded weights.

use super::{LATENT, Latent, Layers, Network, OVERREACH};
use crate::arm::{ARM_Q, ArmQ, FEATURES};
use perceptron::plain;

/// Number of inputs.
const INPUTS: usize = 64;
/// Largest error: of a latent, relative to its size if that is above 1, and of a joint, rad (0.06 degrees). The shipped
/// weights err by 2e-5, which is the rounding of single precision over seven layers. A wrong sum errs by far more.
const ERROR_MAX: f64 = 1e-3;

/// Returns the largest error if it exceeds the bound.
pub(crate) fn error(network: &Network, layers: &Layers) -> Result<(), f64> {
    let mut worst = 0.0_f64;
    for n in 0..INPUTS {
        // Spread over [-1, 1], like features and normalised positions.
        let wave = |i: usize| ((1 + n) as f64 * (1.0 + 0.37 * i as f64)).sin();
        let features: [f32; FEATURES] = std::array::from_fn(|i| wave(i) as f32);
        let q: ArmQ = std::array::from_fn(|j| network.mid[j] + network.half[j] * wave(j));
        let latent = network.encode_human(&[features])[0];
        let given: Vec<f64> = features.iter().map(|x| f64::from(*x)).collect();
        worst = farther(worst, latents(&latent, &plain(&layers.human, &given)));
        // An empty slot has no range.
        let scaled = |j: usize| if network.half[j] > 0.0 { (q[j] - network.mid[j]) / network.half[j] } else { 0.0 };
        let normalised: Vec<f64> = (0..ARM_Q).map(scaled).collect();
        let robot = network.encode_robot(&[q])[0];
        worst = farther(worst, latents(&robot, &plain(&layers.robot, &normalised)));
        let given: Vec<f64> = latent.iter().map(|x| f64::from(*x)).collect();
        let y = plain(&layers.decoder, &given);
        let decoded = network.decode(&[latent])[0];
        for j in 0..ARM_Q {
            let wanted = network.mid[j] + OVERREACH * network.half[j] * y[j].tanh();
            let wanted = wanted.max(network.q_min[j]).min(network.q_max[j]);
            worst = farther(worst, (decoded[j] - wanted).abs());
        }
    }
    if worst <= ERROR_MAX { Ok(()) } else { Err(worst) }
}

/// Returns the greater of both. NaN is the greatest.
fn farther(a: f64, b: f64) -> f64 {
    if b.is_nan() || b > a { b } else { a }
}

fn latents(got: &Latent, wanted: &[f64]) -> f64 {
    let error = |i: usize| (f64::from(got[i]) - wanted[i]).abs() / wanted[i].abs().max(1.0);
    (0..LATENT).map(error).fold(0.0, farther)
}
