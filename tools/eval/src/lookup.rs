//! The nearest of many random postures by exact S_GR: what a lookup table can do at best.
//!
//! <a, b>^2 = <a a^T, b b^T>, and a symmetric 4 x 4 matrix has 10 components (those off the diagonal count twice), so
//! S_GR = 4 - sum over limbs of <q_h, q_r>^2 of all postures at once is one matrix product over 40 components.

use crate::clips::Human;
use nalgebra::UnitQuaternion;
use rand::RngExt;
use rand_pcg::Pcg64;
use retarget::{ArmModel, ArmQ, Limbs};
use train::gemm::{Mat, multiply, widest};

/// Components of a q q^T.
const SYMMETRIC: usize = 10;
/// Components of four limbs.
const COMPONENTS: usize = 4 * SYMMETRIC;
/// Postures of the table.
pub const POSTURES: usize = 200_000;
/// Seed of the table.
pub const SEED: u64 = 20_260_101;
/// Postures and human poses of one matrix product: the scores of a block (1 MB) stay in the cache.
const BLOCK_POSTURES: usize = 2_000;
const BLOCK_HUMANS: usize = 128;

/// Random postures of both arms, uniform within the limits.
#[derive(Clone, Debug)]
pub struct PostureTable {
    postures: Vec<[ArmQ; 2]>,
    /// `[postures][COMPONENTS]`, row-major.
    components: Vec<f32>,
}

impl PostureTable {
    /// `count` postures drawn from `seed`.
    #[must_use]
    pub fn draw(arm: &ArmModel, count: usize, seed: u64) -> Self {
        let mut rng = Pcg64::new(u128::from(seed), 1);
        let mut draw = || -> ArmQ { std::array::from_fn(|j| rng.random_range(arm.q_min[j]..arm.q_max[j])) };
        let postures: Vec<[ArmQ; 2]> = (0..count).map(|_| [draw(), draw()]).collect();
        let components = postures.iter().flat_map(|[left, right]| row(&[arm.forward(left), arm.forward(right)]));
        Self { components: components.collect(), postures }
    }

    /// The postures.
    #[must_use]
    pub fn postures(&self) -> &[[ArmQ; 2]] {
        &self.postures
    }

    /// For each human pose the posture with the least S_GR over both arms.
    #[must_use]
    pub fn nearest(&self, humans: &[Human]) -> Vec<[ArmQ; 2]> {
        let mut out = Vec::with_capacity(humans.len());
        let mut scores = Vec::new();
        for block in humans.chunks(BLOCK_HUMANS) {
            let queries: Vec<f32> = block.iter().flat_map(row).collect();
            let mut best = vec![(f32::MIN, 0_usize); block.len()];
            for (index, part) in self.components.chunks(BLOCK_POSTURES * COMPONENTS).enumerate() {
                let count = part.len() / COMPONENTS;
                scores.resize(block.len() * count, 0.0);
                let table = Mat::new(part, count, COMPONENTS).t();
                multiply(&mut scores, Mat::new(&queries, block.len(), COMPONENTS), table, false);
                for (row, best) in scores.chunks_exact(count).zip(&mut best) {
                    let highest = widest(|| highest(row));
                    if highest > best.0 {
                        let at = row.iter().position(|score| *score == highest).unwrap_or(0);
                        *best = (highest, index * BLOCK_POSTURES + at);
                    }
                }
            }
            out.extend(best.iter().filter_map(|(_, at)| self.postures.get(*at)));
        }
        out
    }
}

/// The largest of a row, in lanes that the compiler makes one vector of.
#[inline(always)]
fn highest(row: &[f32]) -> f32 {
    let mut lanes = [f32::MIN; 16];
    let (chunks, rest) = row.as_chunks::<16>();
    for chunk in chunks {
        for (lane, value) in lanes.iter_mut().zip(chunk) {
            *lane = if *value > *lane { *value } else { *lane };
        }
    }
    lanes.iter().chain(rest).copied().fold(f32::MIN, f32::max)
}

fn row(arms: &[Limbs; 2]) -> [f32; COMPONENTS] {
    let mut out = [0.0; COMPONENTS];
    let limbs = arms.iter().flat_map(|arm| [&arm.upper, &arm.fore]);
    for (part, limb) in out.chunks_exact_mut(SYMMETRIC).zip(limbs) {
        part.copy_from_slice(&symmetric(limb));
    }
    out
}

fn symmetric(rotation: &UnitQuaternion<f64>) -> [f32; SYMMETRIC] {
    let q = rotation.quaternion();
    let (x, y, z, w) = (q.i, q.j, q.k, q.w);
    let r = std::f64::consts::SQRT_2;
    [x * x, y * y, z * z, w * w, r * x * y, r * x * z, r * x * w, r * y * z, r * y * w, r * z * w].map(|v| v as f32)
}
