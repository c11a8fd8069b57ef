//! Finds the nearest of many random postures by exact S_GR: the best that a lookup table can do.

use crate::clips::Human;
use rand::RngExt;
use rand_pcg::Pcg64;
use retarget::{ArmModel, ArmQ, Limbs};
use train::pairs::Index;

const POSTURES: usize = 200_000;
const SEED: u64 = 20_260_101;

#[derive(Clone, Debug)]
pub struct PostureTable {
    postures: Vec<[ArmQ; 2]>,
    index: Index,
}

impl PostureTable {
    pub fn draw(arm: &ArmModel) -> Self {
        let mut rng = Pcg64::new(u128::from(SEED), 1);
        let mut draw = || -> ArmQ { std::array::from_fn(|j| rng.random_range(arm.q_min[j]..arm.q_max[j])) };
        let postures: Vec<[ArmQ; 2]> = (0..POSTURES).map(|_| [draw(), draw()]).collect();
        let index = Index::new(postures.iter().map(|[left, right]| single(&[arm.forward(left), arm.forward(right)])));
        Self { postures, index }
    }

    /// Returns for each human pose the posture with the least S_GR over both arms.
    pub fn nearest(&self, humans: &[Human]) -> Vec<[ArmQ; 2]> {
        let humans: Vec<_> = humans.iter().map(single).collect();
        self.index.nearest(&humans).into_iter().filter_map(|at| self.postures.get(at)).copied().collect()
    }
}

fn single(arms: &[Limbs; 2]) -> [train::kinematics::Limbs; 2] {
    arms.each_ref().map(train::baseline::single)
}
