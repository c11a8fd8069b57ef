//! Trains the perceptron by Adam. It has no constants, so its outputs vanish where nothing turns.
//!
//! ```text
//! minimise  mean over rows, horizons h and limbs of  sqrt(|(N(x) - y) / s_h|^2 + eps^2)
//! ```
//!
//! s_h is the root mean square turn after h. So each horizon counts alike, and a person's fast moves do not rule, as they
//! would with squares.

use super::data::{Recording, Row, rows};
use crate::fit::{Fit, HALF, rounded};
use perceptron::Dense;
use rand_pcg::Pcg64;
use retarget::{HORIZONS_S, PREDICTION_INPUTS, PREDICTION_WIDTHS, Prediction};

/// Peak learning rate (found on the validation clips).
const RATE: f64 = 2e-3;
/// Errors below this share of the mean turn count by their squares (assumption).
const EPS: f32 = 0.05;
/// Instants that scale inputs and outputs.
const SCALE_DRAWS: usize = 4_000;

/// A run. It is bit-reproducible for any number of threads.
#[derive(Clone, Debug)]
pub struct PredictionFit<'a> {
    recordings: &'a [Recording],
    fit: Fit,
    /// Root mean square of each input, and of the turns after each horizon.
    scales: ([f32; PREDICTION_INPUTS], [f32; HORIZONS_S.len()]),
}

impl<'a> PredictionFit<'a> {
    /// Begins a run. `None` if all recordings are shorter than what is predicted.
    pub fn new(recordings: &'a [Recording], steps: u64, seed: u64) -> Option<Self> {
        let scales = scales(recordings, &mut Pcg64::new(u128::from(seed), 0x9ed1))?;
        Some(Self { recordings, fit: Fit::new(&PREDICTION_WIDTHS, RATE, steps, seed), scales })
    }

    /// Takes one step. Returns the mean error of its rows, over the root mean square turn.
    pub fn step(&mut self) -> f64 {
        let Self { recordings, fit, scales: (scales, turns) } = self;
        let drawn = |rng: &mut Pcg64, inputs: &mut [f32]| -> Vec<Row> {
            let drawn = std::iter::repeat_with(|| rows(recordings, rng)).flatten().flatten();
            let drawn: Vec<Row> = drawn.take(HALF).collect();
            for (row, to) in drawn.iter().zip(inputs.chunks_exact_mut(PREDICTION_INPUTS)) {
                to.iter_mut().zip(row.inputs.iter().zip(&*scales)).for_each(|(to, (x, scale))| *to = x / scale);
            }
            drawn
        };
        let mean = fit.step(drawn, |drawn, outputs, by_output| {
            let share = 3.0 / outputs.len() as f32;
            let outputs = outputs.as_chunks::<3>().0.iter().zip(by_output.as_chunks_mut::<3>().0);
            let wanted = drawn.iter().flat_map(|row| row.outputs.as_chunks::<3>().0.iter().enumerate());
            let errors = outputs.zip(wanted).map(|((output, by), (i, turn))| {
                // Two limbs at each horizon.
                let off: [f32; 3] = std::array::from_fn(|axis| output[axis] - turn[axis] / turns[i / 2]);
                let error = (off.iter().map(|x| x * x).sum::<f32>() + EPS * EPS).sqrt();
                *by = off.map(|x| share * x / error);
                f64::from(share * error)
            });
            errors.sum()
        });
        // Constants stay zero: a still person is predicted to stand still.
        for layer in &fit.mlp.layers {
            fit.adam.parameters[layer.bias.clone()].fill(0.0);
            fit.adam.average[layer.bias.clone()].fill(0.0);
        }
        mean
    }

    /// The averaged weights so far, for inputs and outputs as they are, as a file holds them.
    pub fn layers(&self) -> Vec<Dense> {
        let mut layers = self.fit.layers();
        let [first, .., last] = layers.as_mut_slice() else { return layers };
        for row in first.weight.chunks_exact_mut(PREDICTION_INPUTS) {
            row.iter_mut().zip(&self.scales.0).for_each(|(weight, scale)| *weight /= scale);
        }
        for (i, row) in last.weight.chunks_exact_mut(last.inputs).enumerate() {
            row.iter_mut().for_each(|weight| *weight *= self.scales.1[i / 6]);
        }
        rounded(layers)
    }

    pub fn prediction(&self) -> Prediction {
        Prediction::new(&self.layers())
    }
}

/// Measures the scales of [`PredictionFit`].
fn scales(recordings: &[Recording], rng: &mut Pcg64) -> Option<([f32; PREDICTION_INPUTS], [f32; HORIZONS_S.len()])> {
    let drawn: Vec<Row> = (0..SCALE_DRAWS).filter_map(|_| rows(recordings, rng)).flatten().collect();
    let mean = |square: &dyn Fn(&Row) -> f32| drawn.iter().map(square).sum::<f32>() / drawn.len() as f32;
    let root = |square: f32| square.sqrt().max(f32::MIN_POSITIVE);
    let inputs = std::array::from_fn(|i| root(mean(&|row| row.inputs[i] * row.inputs[i])));
    let turn = |row: &Row, h: usize| row.outputs[6 * h..6 * h + 6].iter().map(|x| x * x).sum::<f32>() / 2.0;
    (!drawn.is_empty()).then(|| (inputs, std::array::from_fn(|h| root(mean(&|row| turn(row, h))))))
}

#[cfg(test)]
mod tests {
    use super::super::{Condition, Recording, judge};
    use super::*;
    use crate::clips::Clip;
    use nalgebra::{UnitQuaternion, Vector3};
    use std::f64::consts::TAU;

    /// Both arms swing at `hz`, with different phases of upper arm and forearm.
    fn swinging(hz: f64, seconds: f64) -> Recording {
        let rate_hz = 60.0;
        let arm = |phase: f64| {
            let limbs = |i: usize| {
                let wave = |lag: f64| (TAU * (hz * i as f64 / rate_hz + phase) - lag).sin();
                let upper = UnitQuaternion::from_scaled_axis(Vector3::y() * (0.6 * wave(0.0)))
                    * UnitQuaternion::from_scaled_axis(Vector3::x() * -1.2);
                let fore = UnitQuaternion::from_scaled_axis(Vector3::y() * (-0.6 + 0.4 * wave(0.5))) * upper;
                [upper, fore].map(|limb| retarget::xyzw_from_rotation(&limb).map(|x| x as f32))
            };
            (0..(seconds * rate_hz) as usize).map(limbs).collect()
        };
        Recording::new(&Clip { name: String::new(), frame_rate_hz: rate_hz, arms: [arm(0.0), arm(0.5)] })
    }

    #[test]
    fn fit_predicts_swing_of_unseen_pace_and_ignores_thread_count() {
        let known: Vec<Recording> = [0.6, 0.8, 1.2, 1.5].map(|hz| swinging(hz, 8.0)).into();
        let learn = || {
            let mut fit = PredictionFit::new(&known, 60, 1).expect("enough motion");
            for _ in 0..60 {
                fit.step();
            }
            fit
        };
        let fit = learn();
        let condition = Condition { name: "60_hz", rate_hz: 60.0, noise_deg: 0.0 };
        let means = judge(&[swinging(1.0, 6.0)], &fit.prediction(), &condition);
        let [_, fades, learnt] = means.deg;
        for (learnt, fades) in learnt.iter().zip(fades) {
            assert!(*learnt < 0.5 * fades, "{means:?}");
        }
        let alone = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a pool").install(learn);
        assert_eq!(alone.layers(), fit.layers());
        assert!(fit.layers().iter().flat_map(|layer| &layer.bias).all(|bias| *bias == 0.0), "who stands, stands");
    }

    #[test]
    fn fit_without_enough_motion_returns_none() {
        assert!(PredictionFit::new(&[], 1, 1).is_none());
        assert!(PredictionFit::new(&[swinging(1.0, 0.3)], 1, 1).is_none(), "shorter than what is predicted");
    }
}
