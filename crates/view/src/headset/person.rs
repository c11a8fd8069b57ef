//! The upper body that a headset's poses show, as a frame of the layout XR_BD 24, whose axes are those of WebXR.
//!
//! With body tracking, its joints are taken as they are. Otherwise the head and the hands show the rest: the shoulders hang
//! below the head, and `arm` solves the elbows. The trunk turns after the head, and a look to the side turns it only slowly.

use super::arm::{hinge, solve};
use super::message::{Hand, HandKind, HeadsetFrame, Tracked};
use messages::{
    HingeCalibration, Layout, Limb, RawSkeleton, SMPL_JOINTS, SkeletonLayout, Smpl, Stamp, calibration_flag, raw_flag,
    with_closure,
};
use nalgebra::{UnitQuaternion, Vector3};

/// Joints of a frame of XR_BD 24: those of SMPL-22 and both hands.
const JOINTS: u32 = 24;
/// Heights of eyes and chin, and lengths of trunk, upper arm and forearm, as shares of the stature (Winter, Biomechanics,
/// 4th ed., fig. 4.1). The head turns about the height of the chin: assumption.
const EYES: f64 = 0.936;
const CHIN: f64 = 0.870;
const SHOULDERS: f64 = 0.818;
const TRUNK: f64 = 0.288;
const BONES: [f64; 2] = [0.186, 0.146];
/// Distance of the eyes ahead of the neck, half the breadths of shoulders and hips, and distance from a grip's middle to the
/// wrist. Shares of the stature: assumptions. The breadths are those of the neutral skeleton of `layouts`, and the grip
/// is in the middle of a hand of 0.108 (Winter, fig. 4.1).
const EYES_AHEAD: f64 = 0.046;
const HALF_SHOULDERS: f64 = 0.103;
const HALF_HIPS: f64 = 0.0514;
const GRIP: f64 = 0.054;
/// Breadth of the hips over that of the shoulders, for a body without legs: 0.191 over 0.259 (Winter, fig. 4.1).
const HIPS_PER_SHOULDERS: f64 = 0.74;
/// Lean of the trunk that `skeleton` counts as upright, rad.
const LEAN_RAD: f64 = 0.1;
/// Stature of a person who sits or whom nobody measured, m. Assumption, as in the neutral skeleton of `layouts`.
const STATURE_M: f64 = 1.75;
/// Heights of the eyes of a person who stands, m. Assumption: adults of 1.4 to 2.2 m.
const STANDING_M: core::ops::RangeInclusive<f64> = 1.3..=2.06;
/// The head may look this far to the side before the trunk follows soon, rad: 30 degrees. Assumption.
const ASIDE_RAD: f64 = 0.52;
/// Time constants of the trunk: beyond that angle, and within it, s. Assumptions.
const SOON_S: f64 = 0.5;
const SLOWLY_S: f64 = 5.0;
/// Longest time between two frames that turns the trunk, s.
const PERIOD_MAX_S: f64 = 0.1;
/// Confidences of what the head alone shows, and of an elbow that nobody sees. `ingest` uses joints from 0.5 on.
/// Assumptions.
const FROM_HEAD: f32 = 0.8;
const ELBOW: f32 = 0.6;

/// Arms: shoulder, elbow, wrist, and their limbs.
const ARMS: [([Smpl; 3], [Limb; 2]); 2] = [
    ([Smpl::LeftShoulder, Smpl::LeftElbow, Smpl::LeftWrist], [Limb::LeftUpper, Limb::LeftFore]),
    ([Smpl::RightShoulder, Smpl::RightElbow, Smpl::RightWrist], [Limb::RightUpper, Limb::RightFore]),
];

#[derive(Clone, Copy, Debug, Default)]
pub struct UpperBody {
    stature_m: Option<f64>,
    /// The trunk's turn about the vertical, rad, and its time.
    trunk: Option<(f64, Stamp)>,
}

impl UpperBody {
    /// Returns the person of a frame that arrived at `now`, without a header. `None` if neither the head nor a body is
    /// tracked.
    pub fn person(&mut self, frame: &HeadsetFrame, now: Stamp) -> Option<RawSkeleton> {
        let head = frame.head?;
        let mut out = RawSkeleton::ZERO;
        (out.layout, out.joint_count) = (SkeletonLayout::XrBd24 as u32, JOINTS);
        // A quaternion of zero would be refused.
        out.rotations[..JOINTS as usize].fill([0.0, 0.0, 0.0, 1.0]);
        match &frame.body {
            Some(body) if body[Smpl::Pelvis as usize].is_some() => copy(&mut out, body),
            _ => self.estimate(&mut out, frame, &head, now),
        }
        // The left pinch of a bare hand holds the enable, so it closes no gripper.
        let [left, right] = &frame.hands;
        let is_bare = left.pose.is_some_and(|(kind, _)| kind == HandKind::Wrist);
        out.flags = with_closure(raw_flag::ROTATIONS, [left.closure().filter(|_| !is_bare), right.closure()]);
        Some(out)
    }

    fn estimate(&mut self, out: &mut RawSkeleton, frame: &HeadsetFrame, head: &Tracked, now: Stamp) {
        let stature_m = self.stature_m(frame, head);
        let torso = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), self.turn(head, now));
        let (up, right, ahead) = (Vector3::y(), torso * Vector3::x(), torso * -Vector3::z());
        let neck = head.position + head.rotation * Vector3::new(0.0, (CHIN - EYES) * stature_m, EYES_AHEAD * stature_m);
        let shoulders = neck - up * ((CHIN - SHOULDERS) * stature_m);
        let hips = shoulders + (ahead * LEAN_RAD.sin() - up * LEAN_RAD.cos()) * (TRUNK * stature_m);
        place_joint(out, Smpl::Head, head.position, &head.rotation, 1.0);
        place_joint(out, Smpl::Pelvis, hips, &torso, FROM_HEAD);
        place_joint(out, Smpl::Neck, neck, &torso, FROM_HEAD);
        place_joint(out, Smpl::LeftHip, hips - right * (HALF_HIPS * stature_m), &torso, FROM_HEAD);
        place_joint(out, Smpl::RightHip, hips + right * (HALF_HIPS * stature_m), &torso, FROM_HEAD);
        for (side, ([shoulder, elbow, wrist], limbs)) in ARMS.into_iter().enumerate() {
            let aside = right * if side == 0 { -HALF_SHOULDERS } else { HALF_SHOULDERS };
            let place = shoulders + aside * stature_m;
            let Some(hand) = wrist_of(side, &frame.hands[side], stature_m) else {
                place_joint(out, shoulder, place, &torso, FROM_HEAD);
                continue;
            };
            let arm = solve(side, &torso, place, hand.position, BONES.map(|share| share * stature_m));
            place_joint(out, shoulder, place, &arm.upper, FROM_HEAD);
            place_joint(out, elbow, arm.elbow, &arm.fore, ELBOW);
            place_joint(out, wrist, arm.wrist, &hand.rotation, 1.0);
            // Both the solved shoulder and the wrist of WebXR have the elbow's axis at a known place.
            for limb in limbs {
                mark_hinge(&mut out.calibration, limb, hinge(side));
            }
        }
    }

    /// Returns the stature, which never changes within a session: bones that grow are refused.
    fn stature_m(&mut self, frame: &HeadsetFrame, head: &Tracked) -> f64 {
        *self.stature_m.get_or_insert_with(|| match frame.stature_m {
            Some(given) => f64::from(given),
            None if STANDING_M.contains(&head.position.y) => head.position.y / EYES,
            None => STATURE_M,
        })
    }

    /// Returns the trunk's turn about the vertical, rad.
    fn turn(&mut self, head: &Tracked, now: Stamp) -> f64 {
        let (look, up) = (head.rotation * -Vector3::z(), head.rotation * Vector3::y());
        // The crown tells the direction of a wearer who looks straight down or up. It points ahead of the one, and behind the other.
        let flat = look - up * look.y;
        let wished = (-flat.x).atan2(-flat.z);
        let (before, at) = self.trunk.unwrap_or((wished, now));
        let period_s = (now.since(at) as f64 * 1e-9).min(PERIOD_MAX_S);
        let off = wrapped(wished - before);
        let near = off.clamp(-ASIDE_RAD, ASIDE_RAD);
        let step = near * (1.0 - (-period_s / SLOWLY_S).exp()) + (off - near) * (1.0 - (-period_s / SOON_S).exp());
        let turn = wrapped(before + step);
        self.trunk = Some((turn, now));
        turn
    }
}

fn wrapped(angle_rad: f64) -> f64 {
    angle_rad.sin().atan2(angle_rad.cos())
}

fn place_joint(out: &mut RawSkeleton, joint: Smpl, at: Vector3<f64>, turn: &UnitQuaternion<f64>, confidence: f32) {
    let joint = joint as usize;
    out.positions[joint] = [at.x, at.y, at.z].map(|c| c as f32);
    out.rotations[joint] = [turn.i, turn.j, turn.k, turn.w].map(|c| c as f32);
    out.confidence[joint] = confidence;
}

fn mark_hinge(calibration: &mut HingeCalibration, limb: Limb, axis: Vector3<f64>) {
    calibration.hinge[limb as usize] = [axis.x, axis.y, axis.z].map(|c| c as f32);
    calibration.flags |= calibration_flag::LIMB[limb as usize];
}

/// Copies the joints of a tracked body. A body without legs gets its hips beside the pelvis.
fn copy(out: &mut RawSkeleton, body: &[Option<Tracked>; SMPL_JOINTS]) {
    for (joint, pose) in body.iter().enumerate() {
        let Some(pose) = pose else { continue };
        let (at, turn) = (pose.position, pose.rotation);
        out.positions[joint] = [at.x, at.y, at.z].map(|c| c as f32);
        out.rotations[joint] = [turn.i, turn.j, turn.k, turn.w].map(|c| c as f32);
        out.confidence[joint] = pose.confidence;
    }
    let at = |joint: Smpl| body[joint as usize];
    let (Some(pelvis), Some(left), Some(right)) = (at(Smpl::Pelvis), at(Smpl::LeftShoulder), at(Smpl::RightShoulder))
    else {
        return;
    };
    let aside = (right.position - left.position) * (HIPS_PER_SHOULDERS / 2.0);
    for (hip, place) in [(Smpl::LeftHip, pelvis.position - aside), (Smpl::RightHip, pelvis.position + aside)] {
        if at(hip).is_none() {
            place_joint(out, hip, place, &pelvis.rotation, pelvis.confidence);
        }
    }
}

/// Returns the wrist of a hand in the axes of WebXR's wrist: -z along the hand, y out of its back. In a grip, -z points to the
/// thumb and y to the wrist. x points out of the palm of the left hand, and out of the back of the right one.
fn wrist_of(side: usize, hand: &Hand, stature_m: f64) -> Option<Tracked> {
    let (kind, pose) = hand.pose?;
    if kind == HandKind::Wrist {
        return Some(pose);
    }
    let position = pose.position + pose.rotation * Vector3::y() * (GRIP * stature_m);
    let sign = if side == 0 { -1.0 } else { 1.0 };
    let axes = nalgebra::Matrix3::from_columns(&[Vector3::z() * sign, Vector3::x() * sign, Vector3::y()]);
    let turn = UnitQuaternion::from_rotation_matrix(&nalgebra::Rotation3::from_matrix_unchecked(axes));
    Some(Tracked { position, rotation: pose.rotation * turn, ..pose })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tracked(x: f64, y: f64, z: f64, rotation: UnitQuaternion<f64>) -> Tracked {
        Tracked { position: Vector3::new(x, y, z), rotation, confidence: 1.0 }
    }

    fn bare(pose: Tracked, pinch_m: f32) -> Hand {
        Hand { pose: Some((HandKind::Wrist, pose)), pinch_m: Some(pinch_m), trigger: None, squeeze: None }
    }

    /// Stands at 1.75 m, looks along -z and holds both hands ahead.
    fn standing(turn: UnitQuaternion<f64>) -> HeadsetFrame {
        let hand =
            |x: f64| bare(Tracked { position: turn * Vector3::new(x, 1.2, -0.45), ..tracked(0., 0., 0., turn) }, 0.06);
        HeadsetFrame {
            sent_ms: 0.0,
            age_ms: 1.0,
            stature_m: None,
            head: Some(Tracked { position: Vector3::y() * (EYES * 1.75), ..tracked(0., 0., 0., turn) }),
            hands: [hand(-0.2), hand(0.2)],
            body: None,
        }
    }

    fn at(out: &RawSkeleton, joint: Smpl) -> Vector3<f64> {
        Vector3::from(out.positions[joint as usize].map(f64::from))
    }

    #[test]
    fn standing_person_has_the_proportions_of_the_stature() {
        let out = UpperBody::default().person(&standing(UnitQuaternion::identity()), Stamp(1)).expect("a person");
        assert_eq!((out.layout, out.joint_count), (SkeletonLayout::XrBd24 as u32, 24));
        let [left, right] = [Smpl::LeftShoulder, Smpl::RightShoulder].map(|joint| at(&out, joint));
        assert!((left.y - 0.818 * 1.75).abs() < 1e-6 && left.x < 0.0 && (left + right).x.abs() < 1e-6);
        let hips = (at(&out, Smpl::LeftHip) + at(&out, Smpl::RightHip)) / 2.0;
        assert!(((left + right) / 2.0 - hips).norm() - 0.288 * 1.75 < 1e-6);
        for (side, shoulder, elbow, wrist) in [
            (0, Smpl::LeftShoulder, Smpl::LeftElbow, Smpl::LeftWrist),
            (1, Smpl::RightShoulder, Smpl::RightElbow, Smpl::RightWrist),
        ] {
            let [s, e, w] = [shoulder, elbow, wrist].map(|joint| at(&out, joint));
            assert!(((e - s).norm() - 0.186 * 1.75).abs() < 1e-6 && ((w - e).norm() - 0.146 * 1.75).abs() < 1e-6);
            assert!(e.y < s.y.min(w.y) + 0.1 && (out.confidence[elbow as usize] - ELBOW).abs() < 1e-6, "{side}: {e}");
        }
        assert_eq!(out.calibration.flags, calibration_flag::ALL);
        assert_eq!(messages::closure_of(out.flags)[0], None, "the left pinch is the enable");
        assert!((messages::closure_of(out.flags)[1].expect("known") - 0.5).abs() < 0.01);
    }

    /// A turned person has the same body, turned.
    #[test]
    fn body_turns_with_the_person() {
        let turn = UnitQuaternion::from_euler_angles(0.0, 2.0, 0.0);
        let plain = UpperBody::default().person(&standing(UnitQuaternion::identity()), Stamp(1)).expect("a person");
        let turned = UpperBody::default().person(&standing(turn), Stamp(1)).expect("a person");
        for joint in [Smpl::LeftHip, Smpl::LeftElbow, Smpl::RightElbow, Smpl::RightWrist] {
            assert!((turn * at(&plain, joint) - at(&turned, joint)).norm() < 1e-6, "{joint:?}");
        }
    }

    #[test]
    fn look_to_the_side_or_down_moves_the_shoulders_little() {
        let mut body = UpperBody::default();
        let mut frame = standing(UnitQuaternion::identity());
        let before = body.person(&frame, Stamp(1)).expect("a person");
        let still = frame.head.expect("a head").position;
        let neck = still + Vector3::new(0.0, (CHIN - EYES) * 1.75, EYES_AHEAD * 1.75);
        for turn in
            [UnitQuaternion::from_euler_angles(0.0, 0.5, 0.0), UnitQuaternion::from_euler_angles(-1.2, 0.0, 0.0)]
        {
            frame.head = Some(Tracked { position: neck + turn * (still - neck), ..tracked(0., 0., 0., turn) });
            let after = body.person(&frame, Stamp(100_000_000)).expect("a person");
            let moved = (at(&after, Smpl::LeftShoulder) - at(&before, Smpl::LeftShoulder)).norm();
            assert!(moved < 0.01, "{moved}");
        }
        // The trunk follows a wearer who turns round.
        let turn = UnitQuaternion::from_euler_angles(0.0, 3.0, 0.0);
        frame = standing(turn);
        let mut last = before;
        for n in 2..200 {
            last = body.person(&frame, Stamp(n * 100_000_000)).expect("a person");
        }
        assert!((at(&last, Smpl::LeftShoulder) - turn * at(&before, Smpl::LeftShoulder)).norm() < 0.02);
    }

    #[test]
    fn f133_unseen_hand_or_head_has_no_confidence() {
        let mut frame = standing(UnitQuaternion::identity());
        frame.hands[0].pose = None;
        let out = UpperBody::default().person(&frame, Stamp(1)).expect("a person");
        assert_eq!([Smpl::LeftElbow, Smpl::LeftWrist].map(|joint| out.confidence[joint as usize]), [0.0; 2]);
        assert!(out.confidence[Smpl::RightWrist as usize] > 0.5);
        frame.head = None;
        assert!(UpperBody::default().person(&frame, Stamp(1)).is_none());
    }

    /// A controller in a fist shows the same wrist as the bare hand.
    #[test]
    fn grip_shows_the_wrist_of_the_hand() {
        // Left palm down, fingers to the left: the wrist's y is up. The grip's x is down and its -z ahead.
        for (side, x) in [(0, -Vector3::y()), (1, Vector3::y())] {
            let y = if side == 0 { Vector3::x() } else { -Vector3::x() };
            let axes: nalgebra::Matrix3<f64> = nalgebra::Matrix3::from_columns(&[x, y, Vector3::z()]);
            assert!((axes.determinant() - 1.0).abs() < 1e-9);
            let rotation = UnitQuaternion::from_rotation_matrix(&nalgebra::Rotation3::from_matrix_unchecked(axes));
            let pose = tracked(0.0, 1.0, 0.0, rotation);
            let hand = Hand { pose: Some((HandKind::Grip, pose)), pinch_m: None, trigger: Some(0.3), squeeze: None };
            let wrist = wrist_of(side, &hand, 1.75).expect("tracked");
            assert!((wrist.rotation * Vector3::y() - Vector3::y()).norm() < 1e-9, "the back is up");
            assert!((wrist.rotation * -Vector3::z() + y).norm() < 1e-9, "the fingers point outwards");
            assert!(wrist.position.x * y.x > 0.09, "the wrist is nearer to the body");
            assert_eq!(hand.closure(), Some(0.3));
        }
    }

    #[test]
    fn tracked_body_is_taken_as_it_is() {
        let mut body: Box<[Option<Tracked>; SMPL_JOINTS]> = Box::new([None; SMPL_JOINTS]);
        let turn = UnitQuaternion::from_euler_angles(0.1, 0.2, 0.3);
        for (joint, x, y) in
            [(Smpl::Pelvis, 0.0, 1.0), (Smpl::LeftShoulder, -0.2, 1.5), (Smpl::RightShoulder, 0.2, 1.5)]
        {
            body[joint as usize] = Some(tracked(x, y, 0.0, turn));
        }
        let frame = HeadsetFrame { body: Some(body), ..standing(turn) };
        let out = UpperBody::default().person(&frame, Stamp(1)).expect("a person");
        assert_eq!(at(&out, Smpl::LeftShoulder), Vector3::new(f64::from(-0.2_f32), 1.5, 0.0));
        assert!((at(&out, Smpl::LeftHip).x + 0.148).abs() < 1e-6 && out.confidence[Smpl::LeftHip as usize] == 1.0);
        assert_eq!((out.confidence[Smpl::LeftWrist as usize], out.calibration.flags), (0.0, 0));
    }
}
