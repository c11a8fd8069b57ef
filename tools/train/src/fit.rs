//! Training of one perceptron by Adam, on rows that are drawn for each step.

use crate::mlp::{Mlp, Shape, Trace};
use crate::optimiser::{Adam, Schedule};
use perceptron::Dense;
use rand_pcg::Pcg64;

/// Rows of half a step, which one thread draws.
pub const HALF: usize = 256;

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
    pub mlp: Mlp,
    pub adam: Adam,
    schedule: Schedule,
    shards: [Shard; 2],
    seed: u64,
    step: u64,
}

impl Fit {
    /// Begins a run with random weights of a network of these widths.
    pub fn new(widths: &[usize], rate: f64, steps: u64, seed: u64) -> Self {
        let (input, hidden_width, output) = (widths[0], widths[1], widths[widths.len() - 1]);
        let mlp = Mlp::new(Shape { input, hidden_layers: widths.len() - 2, hidden_width, output }, 0);
        let mut parameters = vec![0.0; mlp.end()];
        mlp.draw(&mut parameters, &mut Pcg64::new(u128::from(seed), 0x11f7));
        let (gradient, by_output) = (vec![0.0; mlp.end()], vec![0.0; HALF * output]);
        let shard = Shard { trace: mlp.trace(HALF), gradient, by_output };
        let schedule = Schedule { peak: rate, warm_up: 500.min(steps / 4), second_decay: 0.999, steps };
        Self { mlp, adam: Adam::new(parameters), schedule, shards: [shard.clone(), shard], seed, step: 0 }
    }

    /// Takes one step. `draw` fills the inputs of half a batch. `judge` gets what it returned and the outputs. It writes
    /// the loss's gradient with respect to them, and returns a figure. The step returns the mean of both halves' figures.
    pub fn step<T>(
        &mut self,
        draw: impl Fn(&mut Pcg64, &mut [f32]) -> T + Sync,
        judge: impl Fn(&T, &[f32], &mut [f32]) -> f64 + Sync,
    ) -> f64 {
        let Self { mlp, adam, shards: [left, right], seed, step, .. } = self;
        let parameters = adam.parameters.as_slice();
        let work = |shard: &mut Shard, index: u64| {
            let mut rng = Pcg64::new(u128::from(*seed) << 64 | u128::from(*step), u128::from(index));
            let Shard { trace, gradient, by_output } = shard;
            let rows = draw(&mut rng, &mut trace.input);
            mlp.forward(parameters, trace);
            let figure = judge(&rows, &trace.output, by_output);
            gradient.fill(0.0);
            mlp.backward(parameters, trace, by_output, gradient, None);
            figure
        };
        let (of_left, of_right) = rayon::join(|| work(left, 0), || work(right, 1));
        let [left, right] = &self.shards;
        self.adam.step([&left.gradient, &right.gradient], self.step, &self.schedule);
        self.step += 1;
        (of_left + of_right) / 2.0
    }

    /// The averaged weights so far.
    pub fn layers(&self) -> Vec<Dense> {
        self.mlp.dense(&self.adam.average)
    }
}

/// Layers as a file holds them.
pub fn rounded(mut layers: Vec<Dense>) -> Vec<Dense> {
    let values = layers.iter_mut().flat_map(|layer| layer.weight.iter_mut().chain(&mut layer.bias));
    values.for_each(|value| *value = perceptron::rounded(*value));
    layers
}
