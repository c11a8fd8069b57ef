//! Finds pairs by exhaustive search, as S3LE's training requires: for every human pose, the robot posture with
//! the least S_GR among many.
//!
//! sum_j (1 - <a_j, b_j>^2) is least where sum_j <a_j a_j^T, b_j b_j^T> is greatest. A symmetric 4 x 4 matrix
//! has ten numbers (off-diagonal ones times sqrt 2). So a pose of four limbs is a vector of 40, and the search
//! is a matrix product.

use crate::gemm::{Mat, multiply, widest};
use crate::kinematics::{ARM, Arm, Limbs};
use crate::sampling::{Mixture, Pair, Recorded};
use rand::RngExt;
use rand_pcg::Pcg64;
use rayon::prelude::*;

/// Number of values in four limbs' outer products.
const PRODUCTS: usize = 40;
/// Number of human poses and postures per block. Their products fit into the second-level cache.
const HUMANS: usize = 64;
const POSTURES: usize = 2048;

/// Poses of four limbs, prepared for the search of the least S_GR.
#[derive(Clone, Debug)]
pub struct Index {
    /// `[poses, PRODUCTS]`.
    products: Vec<f32>,
}

impl Index {
    pub fn new(poses: impl Iterator<Item = [Limbs; 2]>) -> Self {
        Self { products: poses.flat_map(|pose| products(&pose)).collect() }
    }

    /// Returns for each human pose the index of the nearest pose, or the first of equals.
    pub fn nearest(&self, humans: &[[Limbs; 2]]) -> Vec<usize> {
        let mut out = Vec::with_capacity(humans.len());
        let mut block = Vec::new();
        for part in humans.chunks(HUMANS) {
            let queries: Vec<f32> = part.iter().flat_map(products).collect();
            let mut best = vec![(f32::MIN, 0); part.len()];
            for (index, poses) in self.products.chunks(POSTURES * PRODUCTS).enumerate() {
                let count = poses.len() / PRODUCTS;
                block.resize(part.len() * count, 0.0);
                let poses = Mat::new(poses, count, PRODUCTS).t();
                multiply(&mut block, Mat::new(&queries, part.len(), PRODUCTS), poses, false);
                for (row, best) in block.chunks_exact(count).zip(&mut best) {
                    // Find the greatest value first, in lanes. Search its position only if it is a new maximum.
                    let greatest = widest(|| greatest(row));
                    if greatest > best.0 {
                        let place = row.iter().position(|value| *value == greatest).unwrap_or(0);
                        *best = (greatest, index * POSTURES + place);
                    }
                }
            }
            out.extend(best.into_iter().map(|(_, index)| index));
        }
        out
    }
}

/// Returns the greatest value of a row, in lanes that the compiler turns into one vector.
#[inline(always)]
fn greatest(row: &[f32]) -> f32 {
    let mut lanes = [f32::MIN; 16];
    let (chunks, rest) = row.as_chunks::<16>();
    for chunk in chunks {
        for (lane, value) in lanes.iter_mut().zip(chunk) {
            *lane = if *value > *lane { *value } else { *lane };
        }
    }
    lanes.iter().chain(rest).copied().fold(f32::MIN, f32::max)
}

fn products(arms: &[Limbs; 2]) -> [f32; PRODUCTS] {
    let mut out = [0.0; PRODUCTS];
    for (out, q) in out.chunks_exact_mut(10).zip(arms.as_flattened()) {
        let mut at = 0;
        for i in 0..4 {
            for j in i..4 {
                out[at] = q[i] * q[j] * if i == j { 1.0 } else { std::f32::consts::SQRT_2 };
                at += 1;
            }
        }
    }
    out
}

/// Returns `count` robot postures of both arms, uniform within the limits, normalised to -1..1 over them. The
/// same seed gives the same postures.
pub fn random_postures(count: usize, seed: u64) -> Vec<[[f32; ARM]; 2]> {
    let mut rng = Pcg64::new(u128::from(seed), 0x5e1e);
    let mut joint = || -> f32 { rng.random_range(-1.0..1.0) };
    (0..count).map(|_| std::array::from_fn(|_| std::array::from_fn(|_| joint()))).collect()
}

/// Draws `count` human poses as training does, and matches each with its nearest of `postures`.
pub fn matched(
    arm: &Arm,
    postures: &[[[f32; ARM]; 2]],
    recorded: &Recorded,
    mixture: &Mixture,
    count: usize,
    seed: u64,
) -> Vec<Pair> {
    let mut rng = Pcg64::new(u128::from(seed), 0xa175);
    let recorded_count = ((1.0 - mixture.procedural) * count as f64).round() as usize;
    let humans: Vec<[Limbs; 2]> = (0..count)
        .map(|index| {
            let mut arms = [[[0.0; 4]; 2]; 2];
            recorded.draw(&mut rng, index < recorded_count, mixture, &mut arms);
            arms
        })
        .collect();
    let index = Index::new(postures.iter().map(|q| q.map(|q| arm.forward(&arm.denormalised(&q)))));
    let nearest = humans.par_chunks(HUMANS).flat_map_iter(|part| index.nearest(part));
    let nearest: Vec<usize> = nearest.collect();
    humans.into_iter().zip(nearest).map(|(human, index)| Pair { human, posture: postures[index] }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kinematics::{s_gr, tests::example_arm};

    #[test]
    fn pair_search_finds_the_least_distance_over_all_postures() {
        let arm = example_arm();
        let postures = random_postures(3 * POSTURES + 17, 5);
        let pairs = matched(&arm, &postures, &Recorded::default(), &Mixture::default(), 2 * HUMANS + 3, 6);
        assert_eq!(pairs.len(), 2 * HUMANS + 3);
        for pair in pairs {
            let distance = |posture: &[[f32; ARM]; 2]| -> f32 {
                let limbs = posture.map(|q| arm.forward(&arm.denormalised(&q)));
                s_gr(&limbs[0], &pair.human[0]) + s_gr(&limbs[1], &pair.human[1])
            };
            let least = postures.iter().map(&distance).fold(f32::MAX, f32::min);
            assert!(distance(&pair.posture) <= least + 1e-5, "{} against {least}", distance(&pair.posture));
        }
    }
}
