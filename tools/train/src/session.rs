//! A training run in memory: networks, optimiser and two shards, one thread each.

use crate::kinematics::{ARM, Arm, FEATURES, Limbs, features, limb_degrees};
use crate::networks::{LATENT, Networks, REACH, Size};
use crate::objective::{Shard, Terms, Weighting};
use crate::optimiser::{Adam, Schedule};
use crate::sampling::{Mixture, Recorded};

/// What defines a run, besides its data.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Options {
    /// Hidden layers of the perceptrons.
    pub size: Size,
    /// Poses per step; even, half of it per thread.
    pub batch: usize,
    /// Learning rate over the steps.
    pub schedule: Schedule,
    /// Seed of weights and poses.
    pub seed: u64,
    /// Weights of the loss terms.
    pub weighting: Weighting,
    /// How human poses are drawn.
    pub mixture: Mixture,
}

/// A run. Bit-reproducible: the shards are fixed, and their gradients are added in one order.
#[derive(Clone, Debug)]
pub struct Session {
    /// What it was made from.
    pub options: Options,
    /// Layout of the parameters.
    pub networks: Networks,
    /// Parameters, moments and average.
    pub adam: Adam,
    /// Steps done.
    pub step: u64,
    arm: Arm,
    shards: [Shard; 2],
}

impl Session {
    /// A fresh run for `arm`.
    #[must_use]
    pub fn new(options: Options, arm: Arm) -> Self {
        let networks = Networks::new(options.size);
        let adam = Adam::new(networks.initial(options.seed));
        let shard = Shard::new(&networks, options.batch / 2);
        Self { options, networks, adam, step: 0, arm, shards: [shard.clone(), shard] }
    }

    /// One step of Adam; the loss terms of its batch.
    pub fn advance(&mut self, recorded: &Recorded) -> Terms {
        let Self { options, networks, adam, step, arm, shards: [left, right] } = self;
        let parameters = adam.parameters.as_slice();
        let work = |shard: &mut Shard, index: u64| {
            shard.batch.draw(options.seed, *step, index, arm, recorded, &options.mixture);
            shard.evaluate(networks, arm, parameters, &options.weighting)
        };
        let (of_left, of_right) = std::thread::scope(|scope| {
            let other = scope.spawn(|| work(right, 1));
            let mine = work(left, 0);
            // A panic of the other thread is a bug: it aborts the process (profile), or is passed on under `cargo test`.
            (mine, other.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic)))
        });
        adam.step([&left.gradient, &right.gradient], *step, &options.schedule);
        *step += 1;
        Terms::mean(&of_left, &of_right)
    }

    /// Joint positions (rad, within the limits) that the averaged networks give for human limbs, without refinement.
    #[must_use]
    pub fn retarget(&self, poses: &[Limbs]) -> Vec<[f32; ARM]> {
        retarget(&self.networks, &self.adam.average, &self.arm, poses)
    }

    /// Mean rotation error in degrees of the averaged networks over both limbs of `poses`.
    #[must_use]
    pub fn mean_limb_degrees(&self, poses: &[Limbs]) -> f64 {
        let sum: f64 = poses
            .iter()
            .zip(self.retarget(poses))
            .flat_map(|(human, q)| {
                let robot = self.arm.forward(&q);
                [limb_degrees(human[0], robot[0]), limb_degrees(human[1], robot[1])]
            })
            .map(f64::from)
            .sum();
        sum / (2 * poses.len()).max(1) as f64
    }
}

/// D_r(Q_h(features)), clamped to the limits.
#[must_use]
pub fn retarget(networks: &Networks, parameters: &[f32], arm: &Arm, poses: &[Limbs]) -> Vec<[f32; ARM]> {
    // Rows per pass: small enough for the second-level cache.
    const ROWS: usize = 256;
    let mut human = networks.human.trace(ROWS);
    let mut decoder = networks.decoder.trace(ROWS);
    let mut out = Vec::with_capacity(poses.len());
    for chunk in poses.chunks(ROWS) {
        for (row, limbs) in chunk.iter().enumerate() {
            human.input[row * FEATURES..(row + 1) * FEATURES].copy_from_slice(&features(limbs));
        }
        networks.human.forward(parameters, &mut human);
        decoder.input.copy_from_slice(&human.output[..ROWS * LATENT]);
        networks.decoder.forward(parameters, &mut decoder);
        for row in 0..chunk.len() {
            let n = std::array::from_fn(|j| (REACH * decoder.output[row * ARM + j].tanh()).clamp(-1.0, 1.0));
            out.push(arm.denormalised(&n));
        }
    }
    out
}
