//! The best posture that the arm can reach: S_GR minimised from many starts. Meant for evaluation. It allocates
//! nothing, but is slow.

use crate::arm::{ArmModel, ArmQ};
use crate::closed_form::branch;
use crate::refine::{Refined, distance, refine};
use robot::Limbs;

/// Steps per start. Levenberg-Marquardt converges in 5 to 15 here. The rest is for starts at the edge of a basin.
const STEPS: u32 = 40;

/// Random starts, in addition to the four that are not random. More starts change the mean error by less than 0.01
/// degrees.
const RANDOM_STARTS: u32 = 6;
/// The same for an arm without a closed form.
const RANDOM_STARTS_ALONE: u32 = 30;
const SEED: u64 = 7;

/// Minimises S_GR of one arm within its limits. The starts are both branches of the closed form, `previous`, the
/// middle of the limits, and pseudo-random postures. Among optima that are equal to 1e-9 it returns the one nearest
/// to `previous`. So a sequence does not wander where joints are degenerate.
pub fn oracle(arm: &ArmModel, human: &Limbs, previous: &ArmQ) -> Refined {
    let end = |start: ArmQ| refine(arm, human, &start, &start, 0.0, STEPS);
    let branches = [-1.0, 1.0].map(|sign| arm.has_closed_form.then(|| branch(arm, human, previous, sign)));
    let known = [branches[0], Some(arm.clamp(previous)), Some(arm.mid())].into_iter().flatten();
    let mut draw = SplitMix(SEED);
    let random = (0..if arm.has_closed_form { RANDOM_STARTS } else { RANDOM_STARTS_ALONE })
        .map(|_| std::array::from_fn(|j| arm.q_min[j] + draw.next_unit() * (arm.q_max[j] - arm.q_min[j])));
    let first = end(branches[1].unwrap_or(*previous));
    known.chain(random).map(end).fold(first, |best, end| {
        let equal = (end.s_gr - best.s_gr).abs() <= 1e-9;
        let nearer = distance(&end.q, previous) < distance(&best.q, previous);
        if if equal { nearer } else { end.s_gr < best.s_gr } { end } else { best }
    })
}

/// SplitMix64 (Steele, Lea, Flood 2014). It is good enough for starts, and the same on every machine.
struct SplitMix(u64);

impl SplitMix {
    fn next_unit(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }
}
