//! The network's loss and its training by Adam.

use super::BATCH;
use super::people::People;
use super::view::{Errors, View, draw};
use crate::mlp::{Mlp, Shape, Trace};
use crate::optimiser::{Adam, Schedule};
use layouts::{DIRECTIONS, LIFTER_INPUTS, LIFTER_OUTPUTS, LIFTER_WIDTHS, Lifter};
use nalgebra::Vector3;
use perceptron::Dense;
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

/// One thread's half of a batch.
#[derive(Clone, Debug)]
struct Shard {
    trace: Trace,
    gradient: Vec<f32>,
    by_output: Vec<f32>,
}

/// A run. It is bit-reproducible for any number of threads.
#[derive(Clone, Debug)]
pub struct Fit {
    mlp: Mlp,
    adam: Adam,
    schedule: Schedule,
    shards: [Shard; 2],
    seed: u64,
    step: u64,
}

impl Fit {
    pub fn new(steps: u64, seed: u64) -> Self {
        let [input, hidden_width, .., output] = LIFTER_WIDTHS;
        let mlp = Mlp::new(Shape { input, hidden_layers: LIFTER_WIDTHS.len() - 2, hidden_width, output }, 0);
        let mut rng = Pcg64::new(u128::from(seed), 0x11f7);
        let mut parameters = vec![0.0; mlp.end()];
        mlp.draw(&mut parameters, &mut rng);
        let rows = BATCH / 2;
        let shard =
            Shard { trace: mlp.trace(rows), gradient: vec![0.0; mlp.end()], by_output: vec![0.0; rows * output] };
        let schedule = Schedule { peak: RATE, warm_up: 500.min(steps / 4), second_decay: 0.999, steps };
        Self { mlp, adam: Adam::new(parameters), schedule, shards: [shard.clone(), shard], seed, step: 0 }
    }

    /// Takes one step. Returns the mean angle of the arms in its batch, degrees.
    pub fn step(&mut self, people: &People, real: Option<&Errors>) -> f64 {
        let Self { mlp, adam, shards: [left, right], seed, step, .. } = self;
        let parameters = adam.parameters.as_slice();
        let work = |shard: &mut Shard, index: u64| {
            let mut rng = Pcg64::new(u128::from(*seed) << 64 | u128::from(*step), u128::from(index));
            let rows = BATCH / 2;
            let views: Vec<View> = (0..rows).map(|_| draw(people, real, &mut rng)).collect();
            for (view, input) in views.iter().zip(shard.trace.input.chunks_exact_mut(LIFTER_INPUTS)) {
                input.copy_from_slice(&view.inputs);
            }
            mlp.forward(parameters, &mut shard.trace);
            let mut sum_deg = 0.0;
            let outputs = shard.trace.output.chunks_exact(LIFTER_OUTPUTS);
            for ((view, output), by) in views.iter().zip(outputs).zip(shard.by_output.chunks_exact_mut(LIFTER_OUTPUTS))
            {
                let (_, degrees) = loss(output, &view.directions, 1.0 / rows as f64, by);
                sum_deg += degrees[..4].iter().sum::<f64>() / 4.0;
            }
            shard.gradient.fill(0.0);
            mlp.backward(parameters, &mut shard.trace, &shard.by_output, &mut shard.gradient, None);
            sum_deg / rows as f64
        };
        let (of_left, of_right) = rayon::join(|| work(left, 0), || work(right, 1));
        let [left, right] = &self.shards;
        self.adam.step([&left.gradient, &right.gradient], self.step, &self.schedule);
        self.step += 1;
        (of_left + of_right) / 2.0
    }

    /// The averaged weights so far, as a file holds them.
    pub fn layers(&self) -> Vec<Dense> {
        let average: Vec<f32> = self.adam.average.iter().copied().map(perceptron::rounded).collect();
        self.mlp.dense(&average)
    }

    pub fn lifter(&self) -> Lifter {
        Lifter::new(&self.layers())
    }
}
