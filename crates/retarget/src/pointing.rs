//! Rotations of the person's hands and head, blended in and out without a step.
//!
//! ```text
//! R = slerp(1, R_seen, w),   w' = +1 / T while seen, -1 / T while not seen,   0 <= w <= 1
//!
//! R_seen  last seen rotation: of the hand against the forearm, or of the head in the torso frame
//! w       weight
//! T       blend time, s
//! ```

use messages::{Skeleton, skeleton_flag};
use nalgebra::UnitQuaternion;
use robot::limbs::{left_rotation, rotation_from_xyzw, slerp};

/// Blend time T, s. Half a turn then is as fast as a quick hand (assumption).
const BLEND_S: f64 = 1.0;

/// A rotation with a weight that changes without a step.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Blend {
    turn: UnitQuaternion<f64>,
    weight: f64,
}

impl Blend {
    /// Advances the weight by `elapsed_s` and returns the blended rotation. `None` at weight zero.
    pub(crate) fn next(&mut self, seen: Option<UnitQuaternion<f64>>, elapsed_s: f64) -> Option<UnitQuaternion<f64>> {
        let share = elapsed_s / BLEND_S;
        self.weight = (self.weight + if seen.is_some() { share } else { -share }).clamp(0.0, 1.0);
        self.turn = seen.unwrap_or(self.turn);
        self.share(None)
    }

    /// Blends `turn`, or the last seen rotation, at the present weight.
    pub(crate) fn share(&self, turn: Option<UnitQuaternion<f64>>) -> Option<UnitQuaternion<f64>> {
        let turn = turn.unwrap_or(self.turn);
        (self.weight > 0.0).then(|| slerp(&UnitQuaternion::identity(), &turn, self.weight))
    }
}

/// Returns the hand rotation of one arm, mirrored to a left arm. `None` if its flag is not set, or if it is no rotation.
pub(crate) fn human_hand(skeleton: &Skeleton, arm: usize) -> Option<UnitQuaternion<f64>> {
    let valid = skeleton.flags & skeleton_flag::HAND[arm] != 0;
    valid.then(|| left_rotation(arm, skeleton.hands[arm].map(f64::from))).flatten()
}

/// Returns the closure of one arm's hand, from 0 (open) to 1 (closed). `None` if its flag is not set, or if it is NaN.
pub(crate) fn human_closure(skeleton: &Skeleton, arm: usize) -> Option<f64> {
    let closure = f64::from(skeleton.closure[arm]);
    (skeleton.flags & skeleton_flag::CLOSURE[arm] != 0 && !closure.is_nan()).then(|| closure.clamp(0.0, 1.0))
}

/// Returns the head rotation. `None` if its flag is not set, or if it is no rotation.
pub(crate) fn human_head(skeleton: &Skeleton) -> Option<UnitQuaternion<f64>> {
    let valid = skeleton.flags & skeleton_flag::HEAD != 0;
    valid.then(|| rotation_from_xyzw(skeleton.head.map(f64::from))).flatten()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn turn_comes_and_goes_over_a_second_without_a_step() {
        let (mut blend, seen) = (Blend::default(), UnitQuaternion::from_euler_angles(0.0, 1.0, 0.0));
        let (mut before, mut gone) = (UnitQuaternion::identity(), None);
        for k in 0..300 {
            let next = blend.next((k < 150).then_some(seen), 0.01);
            let now = next.unwrap_or_default();
            let step = now.angle_to(&before);
            assert!(step <= 0.01 + 1e-9, "step {k}: {step} rad");
            assert!(!(100..150).contains(&k) || now.angle_to(&seen) < 1e-6, "step {k}: it is not whole");
            gone = gone.or((next.is_none()).then_some(k));
            before = now;
        }
        assert!(gone.is_some_and(|k| (249..=251).contains(&k)), "gone at step {gone:?}");
    }
}
