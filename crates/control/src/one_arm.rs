//! An arm that the operator leaves out stays where it is, and the trunk with it. The other one follows.

use messages::JOINTS_MAX;
use robot::Model;

use crate::following::Reference;

/// The posture in which an arm was left out, rad and m. `None` while both arms follow.
#[derive(Clone, Debug, Default)]
pub(super) struct Anchor(Option<[f64; JOINTS_MAX]>);

impl Anchor {
    /// Lets the arms that are left out stay where they were at the command `q`, and not go home. The lift or waist that
    /// carries them stays, too.
    pub(super) fn hold(
        &mut self,
        model: &Model,
        reference: Option<Reference>,
        q: &[f64; JOINTS_MAX],
        left_out: [bool; 2],
    ) -> Option<Reference> {
        if left_out == [false; 2] {
            self.0 = None;
            return reference;
        }
        let anchor = *self.0.get_or_insert(*q);
        let is_head = |j: usize| model.head.as_ref().is_some_and(|head| head.joints.contains(&Some(j)));
        let follows = |j: usize| (0..2).any(|side| !left_out[side] && model.arms[side].range().contains(&j));
        reference.map(|mut reference| {
            for j in (0..model.count).filter(|&j| !is_head(j) && !follows(j)) {
                (reference.q[j], reference.dq[j], reference.ddq[j], reference.valid_mask) =
                    (anchor[j], 0.0, 0.0, reference.valid_mask | 1 << j);
            }
            reference
        })
    }
}
