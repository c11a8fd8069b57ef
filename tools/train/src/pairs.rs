//! Pairs by exhaustive search, as S3LE's training wants them: for every human pose the robot posture of least S_GR among many.
//!
//! sum_j (1 - <a_j, b_j>^2) is least where sum_j <a_j a_j^T, b_j b_j^T> is greatest; a symmetric 4 x 4 matrix has ten
//! numbers (off-diagonal ones times sqrt 2), so a pose of four limbs is a vector of 40 and the search a matrix product.

use crate::gemm::{Mat, multiply};
use crate::kinematics::{ARM, Arm, Limbs};
use crate::sampling::{Mixture, Pair, Recorded};
use rand::RngExt;
use rand_pcg::Pcg64;

/// Numbers of four limbs' outer products.
const PRODUCTS: usize = 40;
/// Human poses and postures per block: their products fit into the second-level cache.
const HUMANS: usize = 64;
const POSTURES: usize = 2048;

/// Robot postures of both arms, drawn uniformly within the limits, with what the search needs.
#[derive(Clone, Debug)]
pub struct Postures {
    /// Joint positions normalised to -1..1 over the limits.
    pub normalised: Vec<[[f32; ARM]; 2]>,
    products: Vec<f32>,
}

impl Postures {
    /// `count` postures of `arm`; the same seed gives the same postures.
    #[must_use]
    pub fn random(arm: &Arm, count: usize, seed: u64) -> Self {
        let mut rng = Pcg64::new(u128::from(seed), 0x5e1e);
        let mut joint = || -> f32 { rng.random_range(-1.0..1.0) };
        let normalised: Vec<[[f32; ARM]; 2]> =
            (0..count).map(|_| std::array::from_fn(|_| std::array::from_fn(|_| joint()))).collect();
        let products =
            normalised.iter().flat_map(|q| products(&q.map(|q| arm.forward(&arm.denormalised(&q))))).collect();
        Self { normalised, products }
    }

    /// For each human pose the index of the posture of least S_GR, the first of equals.
    #[must_use]
    pub fn nearest(&self, humans: &[[Limbs; 2]]) -> Vec<usize> {
        let share = humans.len().div_ceil(2).max(1);
        std::thread::scope(|scope| {
            let parts: Vec<_> = humans.chunks(share).map(|part| scope.spawn(|| self.search(part))).collect();
            // A panic of a thread is a bug: it aborts the process (profile), or is passed on under `cargo test`.
            let join = |part: std::thread::ScopedJoinHandle<'_, Vec<usize>>| {
                part.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))
            };
            parts.into_iter().flat_map(join).collect()
        })
    }

    fn search(&self, humans: &[[Limbs; 2]]) -> Vec<usize> {
        let mut out = Vec::with_capacity(humans.len());
        let mut block = Vec::new();
        for part in humans.chunks(HUMANS) {
            let queries: Vec<f32> = part.iter().flat_map(products).collect();
            let mut best = vec![(f32::MIN, 0); part.len()];
            for (index, postures) in self.products.chunks(POSTURES * PRODUCTS).enumerate() {
                let count = postures.len() / PRODUCTS;
                block.resize(part.len() * count, 0.0);
                let postures = Mat::new(postures, count, PRODUCTS).t();
                multiply(&mut block, Mat::new(&queries, part.len(), PRODUCTS), postures, false);
                for (row, best) in block.chunks_exact(count).zip(&mut best) {
                    // The greatest value first, which vectorises; its place only if it is a new record.
                    let greatest = row.iter().copied().fold(f32::MIN, f32::max);
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

/// `count` human poses, drawn as training draws them, each with its nearest of `postures`.
#[must_use]
pub fn matched(postures: &Postures, recorded: &Recorded, mixture: &Mixture, count: usize, seed: u64) -> Vec<Pair> {
    let mut rng = Pcg64::new(u128::from(seed), 0xa175);
    let recorded_count = ((1.0 - mixture.procedural) * count as f64).round() as usize;
    let humans: Vec<[Limbs; 2]> = (0..count)
        .map(|index| {
            let mut arms = [[[0.0; 4]; 2]; 2];
            recorded.draw(&mut rng, index < recorded_count, mixture, &mut arms);
            arms
        })
        .collect();
    let nearest = postures.nearest(&humans);
    humans.into_iter().zip(nearest).map(|(human, index)| Pair { human, posture: postures.normalised[index] }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kinematics::{s_gr, tests::example_arm};

    #[test]
    fn the_search_finds_what_comparing_all_finds() {
        let arm = example_arm();
        let postures = Postures::random(&arm, 3 * POSTURES + 17, 5);
        let pairs = matched(&postures, &Recorded::default(), &Mixture::default(), 2 * HUMANS + 3, 6);
        assert_eq!(pairs.len(), 2 * HUMANS + 3);
        for pair in pairs {
            let distance = |posture: &[[f32; ARM]; 2]| -> f32 {
                let limbs = posture.map(|q| arm.forward(&arm.denormalised(&q)));
                s_gr(&limbs[0], &pair.human[0]) + s_gr(&limbs[1], &pair.human[1])
            };
            let least = postures.normalised.iter().map(&distance).fold(f32::MAX, f32::min);
            assert!(distance(&pair.posture) <= least + 1e-5, "{} against {least}", distance(&pair.posture));
        }
    }
}
