//! A training run in memory: networks, optimiser and two shards, one thread each.

use crate::kinematics::{ARM, Arm, FEATURES, Limbs, features, limb_degrees};
use crate::networks::{Networks, REACH, Size};
use crate::objective::{Shard, Terms, Weighting};
use crate::optimiser::{Adam, Schedule};
use crate::sampling::{Mixture, Recorded};
use rt::{Exit, Failure};

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    pub size: Size,
    /// Poses per step. The number is even, and each thread takes half of it.
    pub batch: usize,
    pub schedule: Schedule,
    pub seed: u64,
    pub weighting: Weighting,
    pub mixture: Mixture,
}

/// A run. It is bit-reproducible: the shards are fixed, and their gradients are added in one order.
#[derive(Clone, Debug)]
pub struct Session {
    pub options: Options,
    pub networks: Networks,
    pub adam: Adam,
    pub step: u64,
    arm: Arm,
    shards: [Shard; 2],
}

impl Session {
    pub fn new(options: Options, arm: Arm) -> Self {
        let networks = Networks::new(options.size);
        let adam = Adam::new(networks.initial(options.seed));
        let shard = Shard::new(&networks, options.batch / 2);
        Self { options, networks, adam, step: 0, arm, shards: [shard.clone(), shard] }
    }

    /// Begins a new run at these joint positions, normalised to -1..1 over the limits. It begins in their middle
    /// otherwise.
    pub fn starting_at(mut self, start: [f32; ARM]) -> Self {
        if let Some(layer) = self.networks.decoder.layers.last() {
            for bias in self.adam.parameters[layer.bias.clone()].chunks_exact_mut(ARM) {
                bias.copy_from_slice(&start.map(|n| (n / REACH).atanh()));
            }
        }
        self.adam = Adam::new(self.adam.parameters);
        self
    }

    pub fn arm(&self) -> &Arm {
        &self.arm
    }

    /// Takes one step of Adam on poses drawn from `recorded`. Returns the loss terms of its batch.
    pub fn advance(&mut self, recorded: &Recorded) -> Terms {
        let terms = self.differentiate(recorded);
        self.apply();
        terms
    }

    /// Takes one step of several robots. All human encoders get the mean of their gradients. So
    /// encoders that began the same stay the same, and the robots share one latent space.
    pub fn advance_together(sessions: &mut [Self], recorded: &Recorded) -> Vec<Terms> {
        let terms = sessions.iter_mut().map(|session| session.differentiate(recorded)).collect();
        if sessions.len() > 1 {
            let human = 0..sessions[0].networks.human.end();
            let mut mean = vec![0.0; human.len()];
            let weight = 0.5 / sessions.len() as f32;
            for shard in sessions.iter().flat_map(|session| &session.shards) {
                mean.iter_mut().zip(&shard.gradient).for_each(|(mean, gradient)| *mean += weight * gradient);
            }
            for shard in sessions.iter_mut().flat_map(|session| &mut session.shards) {
                shard.gradient[human.clone()].copy_from_slice(&mean);
            }
        }
        sessions.iter_mut().for_each(Self::apply);
        terms
    }

    fn differentiate(&mut self, recorded: &Recorded) -> Terms {
        let Self { options, networks, adam, step, arm, shards: [left, right] } = self;
        let parameters = adam.parameters.as_slice();
        let work = |shard: &mut Shard, index: u64| {
            shard.batch.draw(options.seed, *step, index, arm, recorded, &options.mixture);
            shard.evaluate(networks, arm, parameters, &options.weighting)
        };
        let (of_left, of_right) = rayon::join(|| work(left, 0), || work(right, 1));
        // Both shards have the same size.
        of_left.zip(&of_right, |a, b| 0.5 * (a + b))
    }

    fn apply(&mut self) {
        let [left, right] = &self.shards;
        self.adam.step([&left.gradient, &right.gradient], self.step, &self.options.schedule);
        self.step += 1;
    }

    /// Returns the mean rotation error in degrees of the averaged networks, without refinement, over the four
    /// limbs of `frames`.
    pub fn mean_limb_degrees(&self, frames: &[[Limbs; 2]]) -> f64 {
        let postures = retarget(&self.networks, &self.adam.average, &self.arm, frames);
        let pairs = frames.as_flattened().iter().zip(postures.as_flattened());
        let degrees = pairs.flat_map(|(human, q)| {
            let robot = self.arm.forward(q);
            let human = self.arm.target(human, &robot);
            [limb_degrees(human[0], robot[0]), limb_degrees(human[1], robot[1])]
        });
        let sum: f64 = degrees.map(f64::from).sum();
        sum / (4 * frames.len()).max(1) as f64
    }
}

pub(crate) fn diverged(step: u64) -> Failure {
    let text = format!("the loss is not finite at step {step}; a lower learning rate or another seed may help");
    Failure::new(Exit::Software, text)
}

// Rows per pass. The number is small enough for the second-level cache.
const ROWS: usize = 256;

/// Returns D_r(Q_h(x_h)), clamped to the limits, rad: both arms of every frame, both as left arms.
pub fn retarget(networks: &Networks, parameters: &[f32], arm: &Arm, frames: &[[Limbs; 2]]) -> Vec<[[f32; ARM]; 2]> {
    let mut human = networks.human.trace(ROWS);
    let mut decoder = networks.decoder.trace(ROWS);
    let mut out = vec![[[0.0; ARM]; 2]; frames.len()];
    let postures = out.as_flattened_mut().as_flattened_mut();
    for (limbs, q) in frames.as_flattened().chunks(ROWS).zip(postures.chunks_mut(ROWS * ARM)) {
        for (limbs, row) in limbs.iter().zip(human.input.as_chunks_mut::<FEATURES>().0) {
            *row = features(limbs);
        }
        networks.human.forward(parameters, &mut human);
        decoder.input.copy_from_slice(&human.output);
        networks.decoder.forward(parameters, &mut decoder);
        for (q, y) in q.as_chunks_mut::<ARM>().0.iter_mut().zip(decoder.output.as_chunks::<ARM>().0) {
            *q = arm.denormalised(&y.map(|y| (REACH * y.tanh()).clamp(-1.0, 1.0)));
        }
    }
    out
}
