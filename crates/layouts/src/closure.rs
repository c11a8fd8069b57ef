//! Closure of the hands from the bones of their fingers.

use messages::{RawSkeleton, SkeletonLayout, closure_of};

/// Unity's bones of the left and the right hand from the index finger to the little one: three bones a finger, from the
/// palm outward (`HumanBodyBones`).
const FINGERS: [core::ops::Range<usize>; 2] = [27..39, 42..54];
/// Turn of a finger of a closed hand, rad: its three joints together. Assumption: 200 degrees hold a thin object. A fist
/// has about 60 more.
const CLOSED_RAD: f32 = 200.0 * core::f32::consts::PI / 180.0;
/// Fingers of a hand that count.
const COUNT: f32 = 4.0;
/// Largest error of a rotation's squared norm.
const NORM_ERROR_MAX: f32 = 2e-3;

/// Returns the closure of the left and the right hand: the value that the client sends, or that of the turns of its fingers. `None`
/// where neither is known.
pub(crate) fn closure(raw: &RawSkeleton) -> [Option<f32>; 2] {
    let [left, right] = closure_of(raw.flags);
    if raw.layout != SkeletonLayout::UnityHumanoid as u32 {
        return [left, right];
    }
    let [left_fingers, right_fingers] = FINGERS;
    [left.or_else(|| of_fingers(raw, left_fingers)), right.or_else(|| of_fingers(raw, right_fingers))]
}

/// Returns the mean turn of the fingers as a share of [`CLOSED_RAD`], at most 1. `None` if a bone is not seen, or no
/// finger is turned at all.
fn of_fingers(raw: &RawSkeleton, bones: core::ops::Range<usize>) -> Option<f32> {
    let (mut turned_rad, mut tracked) = (0.0, false);
    for bone in bones {
        let q = raw.rotations[bone];
        let norm = q.iter().map(|x| x * x).sum::<f32>();
        // Written so that NaN is refused too.
        if !(raw.confidence[bone] > 0.0 && (norm - 1.0).abs() <= NORM_ERROR_MAX) {
            return None;
        }
        tracked |= q[3].abs() != 1.0;
        turned_rad += 2.0 * q[3].abs().min(1.0).acos();
    }
    // Fingers exactly as in the T-pose are those of a program that sees none.
    tracked.then(|| (turned_rad / COUNT / CLOSED_RAD).min(1.0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use messages::{Layout, with_closure};

    fn unity(turn_rad: f32) -> RawSkeleton {
        let mut raw =
            RawSkeleton { layout: SkeletonLayout::UnityHumanoid as u32, joint_count: 55, ..RawSkeleton::ZERO };
        raw.rotations = [[0.0, 0.0, 0.0, 1.0]; messages::RAW_JOINTS_MAX];
        raw.confidence = [1.0; messages::RAW_JOINTS_MAX];
        for bone in FINGERS[0].clone() {
            raw.rotations[bone] = [0.0, 0.0, (turn_rad / 2.0).sin(), (turn_rad / 2.0).cos()];
        }
        raw
    }

    #[test]
    fn fingers_close_hand_and_client_knows_better() {
        let third = CLOSED_RAD / 3.0;
        let [left, right] = closure(&unity(third / 2.0));
        assert!((left.unwrap() - 0.5).abs() < 1e-4 && right.is_none(), "{left:?} {right:?}");
        let [fist, _] = closure(&unity(1.5 * third));
        assert_eq!(fist, Some(1.0));
        let with_zero = RawSkeleton { flags: with_closure(0, [Some(0.0), None]), ..unity(third) };
        assert_eq!(closure(&with_zero), [Some(0.0), None]);
    }

    #[test]
    fn hand_without_a_finger_is_not_known() {
        let mut raw = unity(0.5);
        raw.confidence[FINGERS[0].start] = 0.0;
        raw.rotations[FINGERS[1].start][3] = f32::NAN;
        assert_eq!(closure(&raw), [None, None]);
        assert_eq!(closure(&RawSkeleton { layout: SkeletonLayout::MediaPipe33 as u32, ..unity(0.5) }), [None, None]);
    }
}
