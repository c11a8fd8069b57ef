//! An arm that the operator leaves out stays where it is, and the trunk with it. The other one follows.

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

/// The posture in which an arm was left out, rad and m. `None` while both arms follow.
#[derive(Clone, Debug, Default)]
pub(super) struct Anchor(Option<[f64; JOINTS_MAX]>);

impl Anchor {
    /// Lets the arms that are left out stay where they were at the command `q`, and not go home. The lift or waist that
    /// carries them stays, too.
    pub(super) fn hold(
        &mut self,
        model: &Model,
        wish: Option<Wish>,
        q: &[f64; JOINTS_MAX],
        left_out: [bool; 2],
    ) -> Option<Wish> {
        if left_out == [false; 2] {
            self.0 = None;
            return wish;
        }
        let anchor = *self.0.get_or_insert(*q);
        let is_head = |j: usize| model.head.as_ref().is_some_and(|head| head.joints.contains(&j));
        let follows = |j: usize| (0..2).any(|side| !left_out[side] && model.arms[side].range().contains(&j));
        wish.map(|mut wish| {
            for j in (0..model.count).filter(|&j| !is_head(j) && !follows(j)) {
                (wish.q[j], wish.dq[j], wish.ddq[j], wish.valid_mask) = (anchor[j], 0.0, 0.0, wish.valid_mask | 1 << j);
            }
            wish
        })
    }
}
