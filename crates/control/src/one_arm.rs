//! An arm that the operator leaves out stays where it is. The other one follows.

use messages::{JOINTS_MAX, JointTarget, target_flag};
use robot::Model;

use crate::following::Wish;

/// Returns the target without the arms that are left out: no joint of theirs is valid, and nobody drives them.
pub(super) fn without(model: &Model, mut target: JointTarget, left_out: [bool; 2]) -> JointTarget {
    for side in (0..2).filter(|&side| left_out[side]) {
        model.arms[side].range().for_each(|j| target.valid_mask &= !(1 << j));
        target.human_limbs[2 * side..2 * side + 2].fill([0.0; 4]);
        target.human_hands[side] = [0.0; 4];
        target.flags &= !target_flag::CLOSURE[side];
    }
    target
}

/// Lets the arms that are left out stay at the commanded positions `q`, and not go home.
pub(super) fn hold(model: &Model, mut wish: Wish, q: &[f64; JOINTS_MAX], left_out: [bool; 2]) -> Wish {
    for side in (0..2).filter(|&side| left_out[side]) {
        for j in model.arms[side].range() {
            (wish.q[j], wish.dq[j], wish.ddq[j], wish.valid_mask) = (q[j], 0.0, 0.0, wish.valid_mask | 1 << j);
        }
    }
    wish
}
