//! Finds the nearest of many random postures by exact S_GR: the best that a lookup table can do.

use crate::clips::Human;
use rand::RngExt;
use rand_pcg::Pcg64;
use retarget::{ArmModel, ArmQ, Limbs};
use train::pairs::Index;

/// Number of postures of the table.
pub const POSTURES: usize = 200_000;
/// Seed of the table.
pub const SEED: u64 = 20_260_101;
/// Random postures of both arms, uniform within the limits.
#[derive(Clone, Debug)]
pub struct PostureTable {
    postures: Vec<[ArmQ; 2]>,
    index: Index,
}

impl PostureTable {
    /// Draws `count` postures from `seed`.
    #[must_use]
    pub fn draw(arm: &ArmModel, count: usize, seed: u64) -> Self {
        let mut rng = Pcg64::new(u128::from(seed), 1);
        let mut draw = || -> ArmQ { std::array::from_fn(|j| rng.random_range(arm.q_min[j]..arm.q_max[j])) };
        let postures: Vec<[ArmQ; 2]> = (0..count).map(|_| [draw(), draw()]).collect();
        let index = Index::new(postures.iter().map(|[left, right]| single(&[arm.forward(left), arm.forward(right)])));
        Self { postures, index }
    }

    /// Returns the postures.
    #[must_use]
    pub fn postures(&self) -> &[[ArmQ; 2]] {
        &self.postures
    }

    /// Returns for each human pose the posture with the least S_GR over both arms.
    #[must_use]
    pub fn nearest(&self, humans: &[Human]) -> Vec<[ArmQ; 2]> {
        let humans: Vec<_> = humans.iter().map(single).collect();
        self.index.nearest(&humans).into_iter().filter_map(|at| self.postures.get(at)).copied().collect()
    }
}

/// Converts limb rotations for the search.
fn single(arms: &[Limbs; 2]) -> [train::kinematics::Limbs; 2] {
    arms.each_ref().map(train::baseline::single)
}
