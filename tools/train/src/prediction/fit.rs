//! Ridge regression, weighted so that the mean of the errors becomes small, not that of their squares.
//!
//! ```text
//! minimise  sum over rows  w |W x - y|^2  +  lambda sum over inputs  g |W_i|^2
//! w = 1 / sqrt(|W' x - y|^2 + eps^2),   g the mean square of the input times the sum of w
//! ```
//!
//! W' is the W of the previous round: iteratively reweighted least squares. With unweighted squares, only a
//! person's fast moves would count.

use super::data::Draw;
use nalgebra::{DMatrix, Dyn, linalg::Cholesky};
use rayon::prelude::*;
use retarget::{HORIZONS_S, PREDICTION_OUTPUTS, Prediction};

/// Number of rounds. Each round except the first uses the weights of the previous one (assumption).
const ROUNDS: usize = 4;
/// Errors below this count by their squares, rad.
const EPS_RAD: f64 = 0.01;
/// Share of an input's own mean square that is added to it. Values from 0.02 to 0.1 differed by 0.05 degrees on
/// the validation clips.
const LAMBDA: f64 = 0.05;

/// Returns the map that fits the rows best. None if there are too few rows to determine it.
pub fn fit(draw: &Draw) -> Option<Prediction> {
    let rows = draw.outputs.first()?.len();
    let mut weight = vec![1.0; rows];
    let mut found = None;
    for _ in 0..ROUNDS {
        let map = solve(draw, &weight)?;
        weight = weights(draw, &map);
        found = Some(map);
    }
    let map = found?;
    // Rows are inputs and columns are outputs. The file has them input by input.
    let values: Vec<f32> = map.row_iter().flat_map(|row| row.iter().map(|x| *x as f32).collect::<Vec<_>>()).collect();
    Prediction::new(&values).ok()
}

/// Solves for W, with one row per input. One thread computes each number, so that any number of threads gives
/// the same bits.
fn solve(draw: &Draw, weight: &[f64]) -> Option<DMatrix<f64>> {
    let inputs = draw.inputs.len();
    let columns: Vec<(Vec<f64>, Vec<f64>)> = (draw.inputs.par_iter().enumerate())
        .map(|(i, input)| {
            let weighted: Vec<f64> = input.iter().zip(weight).map(|(x, w)| x * w).collect();
            let gram = draw.inputs[..=i].iter().map(|other| dot(&weighted, other)).collect();
            (gram, draw.outputs.iter().map(|output| dot(&weighted, output)).collect())
        })
        .collect();
    let mut gram = DMatrix::from_fn(inputs, inputs, |i, j| columns[i.max(j)].0[i.min(j)]);
    for i in 0..inputs {
        gram[(i, i)] += LAMBDA * gram[(i, i)];
    }
    let right = DMatrix::from_fn(inputs, draw.outputs.len(), |i, j| columns[i].1[j]);
    let factor: Cholesky<f64, Dyn> = gram.cholesky()?;
    Some(factor.solve(&right))
}

/// Returns one over the error of each row: its root mean square over horizons and limbs.
fn weights(draw: &Draw, map: &DMatrix<f64>) -> Vec<f64> {
    let rows = draw.outputs[0].len();
    let squares = (0..PREDICTION_OUTPUTS).into_par_iter().map(|output| {
        let mut off: Vec<f64> = draw.outputs[output].iter().map(|y| -y).collect();
        for (input, by) in draw.inputs.iter().zip(map.column(output).iter()) {
            off.iter_mut().zip(input).for_each(|(off, x)| *off += by * x);
        }
        off
    });
    let squares: Vec<Vec<f64>> = squares.collect();
    let turns = (2 * HORIZONS_S.len()) as f64;
    (0..rows)
        .map(|row| {
            let square: f64 = squares.iter().map(|off| off[row] * off[row]).sum();
            1.0 / (square / turns + EPS_RAD * EPS_RAD).sqrt()
        })
        .collect()
}

/// Sums in eight partial sums, so that the processor need not wait for each addition.
fn dot(a: &[f64], b: &[f64]) -> f64 {
    let (a, a_rest) = a.as_chunks::<8>();
    let (b, b_rest) = b.as_chunks::<8>();
    let mut sums = [0.0; 8];
    for (a, b) in a.iter().zip(b) {
        for (sum, (a, b)) in sums.iter_mut().zip(a.iter().zip(b)) {
            *sum += a * b;
        }
    }
    sums.iter().sum::<f64>() + a_rest.iter().zip(b_rest).map(|(a, b)| a * b).sum::<f64>()
}

#[cfg(test)]
mod tests {
    use super::super::{Condition, Recording, draw, judge};
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
        let learn = || fit(&draw(&known, 800, 1)).expect("enough rows");
        let prediction = learn();
        let condition = Condition { name: "60_hz", rate_hz: 60.0, noise_deg: 0.0 };
        let means = judge(&[swinging(1.0, 6.0)], &prediction, &condition);
        let [_, fades, learnt] = means.deg;
        for (learnt, fades) in learnt.iter().zip(fades) {
            assert!(*learnt < 0.5 * fades, "{means}");
        }
        let alone = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a pool").install(learn);
        assert_eq!(alone, prediction);
    }

    #[test]
    fn fit_without_enough_motion_returns_none() {
        assert_eq!(fit(&draw(&[], 100, 1)), None);
        assert_eq!(fit(&draw(&[swinging(1.0, 0.3)], 100, 1)), None, "shorter than what is predicted");
    }
}
