//! Limb frames and hinges compared with arms of known angles.

use crate::person::{Body, arm, mirror, person, read, store, t_pose_hinges};
use messages::{HingeCalibration, LIMBS, Layout, calibration_flag, skeleton_flag};
use nalgebra::{UnitQuaternion, Vector3};
use proptest::prelude::*;
use skeleton::{Calibrator, Hold, LimbFrames, limbs_from_positions_rotations, torso_rotation};

fn limbs(body: &Body, calibration: &HingeCalibration) -> LimbFrames {
    limbs_from_positions_rotations(&body.0, Some(&body.1), calibration, u32::MAX, &mut Hold::default())
}

fn angle_deg(a: [f32; 4], b: UnitQuaternion<f64>) -> f64 {
    read(a).angle_to(&b).to_degrees()
}

/// The person in another world: turned, moved, and with other rest orientations of the joints' rotations.
fn seen(body: &Body, world: UnitQuaternion<f64>, rest: [UnitQuaternion<f64>; 3]) -> Body {
    let mut out = *body;
    for (joint, position) in out.0.iter_mut().enumerate() {
        let p = world * Vector3::from(*position).cast::<f64>() + Vector3::new(3.0, -2.0, 0.5);
        *position = p.cast::<f32>().into();
        let rest = match joint {
            16 | 17 => rest[0],
            20 | 21 => rest[1],
            _ => rest[2],
        };
        out.1[joint] = store(world * read(body.1[joint]) * rest);
    }
    out
}

fn any_rotation() -> impl Strategy<Value = UnitQuaternion<f64>> {
    (-3.0..3.0, -1.5..1.5, -3.0..3.0).prop_map(|(x, y, z)| UnitQuaternion::from_euler_angles(x, y, z))
}

fn any_arm() -> impl Strategy<Value = [f64; 5]> {
    [-1.1..1.5, -1.1..1.5, -1.9..1.9, 0.2..2.2, -1.4..1.4]
}

#[test]
fn t_pose_gives_identity_limbs() {
    let body = person([0.0; 5], [0.0; 5]);
    let torso = torso_rotation(&body.0).expect("a trunk");
    assert!((torso - nalgebra::Matrix3::identity()).norm() < 1e-6);
    for calibration in [t_pose_hinges(), HingeCalibration::ZERO] {
        let limbs = limbs(&body, &calibration);
        assert_eq!(limbs.flags & skeleton_flag::ALL, skeleton_flag::ALL);
        assert_eq!(limbs.flags & skeleton_flag::CALIBRATED != 0, calibration.flags != 0);
        for limb in 0..LIMBS {
            assert!(angle_deg(limbs.rotations[limb], UnitQuaternion::identity()) < 0.01);
        }
    }
}

#[test]
fn hinge_without_valid_flag_is_ignored() {
    let body = person([0.3, 0.2, 0.5, 1.0, 0.4], [0.1, 0.2, 0.5, 1.0, 0.4]);
    let mut rubbish = t_pose_hinges();
    rubbish.hinge = [[0.6, 0.0, 0.8]; LIMBS];
    rubbish.flags = 0;
    assert_eq!(limbs(&body, &rubbish), limbs(&body, &HingeCalibration::ZERO));
}

#[test]
fn straight_elbow_holds_its_hinge_without_jump() {
    let mut hold = Hold::default();
    let mut last: Option<[f32; 4]> = None;
    // The arm turns about itself by a right angle while flexed, then stretches, swings, and flexes again.
    for i in 0..=300 {
        let t = f64::from(i) / 100.0;
        let flexion = (1.2 * (1.0 - t)).max(1.2 * (t - 2.0)).max(0.0);
        let body = person([0.5 * t.clamp(1.0, 2.0), 0.4, 1.5, flexion, 0.0], [0.0; 5]);
        let out = limbs_from_positions_rotations(&body.0, None, &HingeCalibration::ZERO, u32::MAX, &mut hold);
        assert_eq!(out.flags & skeleton_flag::CALIBRATED, 0);
        let upper = out.rotations[0];
        let truth = arm([0.5 * t.clamp(1.0, 2.0), 0.4, 1.5, flexion, 0.0]).0;
        assert!(angle_deg(upper, truth) < 20.0, "frame {i}: {} degrees off", angle_deg(upper, truth));
        if let Some(last) = last {
            assert!(angle_deg(upper, read(last)) < 6.0, "frame {i} jumps");
        }
        last = Some(upper);
    }
}

#[test]
fn unseen_joint_invalidates_only_its_limbs() {
    let body = person([0.2; 5], [0.2; 5]);
    let without = |joint: usize| {
        let usable = !(1 << joint);
        limbs_from_positions_rotations(&body.0, Some(&body.1), &t_pose_hinges(), usable, &mut Hold::default()).flags
    };
    let [lu, lf, ru, rf] = skeleton_flag::LIMB;
    assert_eq!(without(20) & skeleton_flag::ALL, lu | ru | rf);
    assert_eq!(without(18) & skeleton_flag::ALL, ru | rf);
    assert_eq!(without(21) & skeleton_flag::ALL, lu | lf | ru);
    assert_eq!(without(16), 0);
    assert_eq!(without(0) & skeleton_flag::ALL, skeleton_flag::ALL);
}

#[test]
fn estimate_needs_flexed_elbows_and_turning_rotations() {
    let mut straight = Calibrator::default();
    let mut numb = Calibrator::default();
    for i in 0..200 {
        let a = f64::from(i) * 0.05;
        let still = person([a.sin(), a.cos() * 0.5, 0.0, 0.05, 0.0], [a.sin(), 0.0, 0.0, 0.05, 0.0]);
        straight.add(&still.0, &still.1, u32::MAX);
        // A rotation that ignores the humeral twist.
        let mut body = person([0.0, 0.0, 1.5 * a.sin(), 1.0, 0.0], [0.0, 0.0, 1.5 * a.sin(), 1.0, 0.0]);
        body.1 = [[0.0, 0.0, 0.0, 1.0]; 22];
        numb.add(&body.0, &body.1, u32::MAX);
    }
    assert_eq!(straight.estimate().flags, 0);
    assert_eq!(numb.estimate().flags, 0);
    assert_eq!(Calibrator::default().estimate().flags, 0);
}

proptest! {
    #[test]
    fn limbs_match_arm_model(left in any_arm(), right in any_arm(), world in any_rotation()) {
        let body = seen(&person(left, right), world, [UnitQuaternion::identity(); 3]);
        let limbs = limbs(&body, &t_pose_hinges());
        let (lu, lf) = arm(left);
        let (ru, rf) = arm(right);
        for (limb, truth) in [lu, lf, mirror(ru), mirror(rf)].into_iter().enumerate() {
            // f32 positions a few metres from the origin over bones of 0.3 m.
            prop_assert!(angle_deg(limbs.rotations[limb], truth) < 0.05);
            prop_assert!(limbs.rotations[limb][3] >= 0.0);
        }
        prop_assert_eq!(limbs.flags, skeleton_flag::ALL | skeleton_flag::CALIBRATED);
    }

    #[test]
    fn calibration_undoes_any_rest_orientation(
        arms in prop::collection::vec((any_arm(), any_arm()), 40),
        world in any_rotation(),
        rest in [any_rotation(), any_rotation(), any_rotation()],
    ) {
        let mut calibrator = Calibrator::default();
        let bodies: Vec<Body> = arms.iter().map(|&(l, r)| seen(&person(l, r), world, rest)).collect();
        for body in &bodies {
            calibrator.add(&body.0, &body.1, u32::MAX);
        }
        let calibration = calibrator.estimate();
        prop_assert_eq!(calibration.flags, calibration_flag::ALL);
        prop_assert_eq!(calibration.samples, 40);
        let mut offsets = Vec::new();
        for (body, &(left, right)) in bodies.iter().zip(&arms) {
            let limbs = limbs(body, &calibration);
            prop_assert!(angle_deg(limbs.rotations[0], arm(left).0) < 0.1);
            prop_assert!(angle_deg(limbs.rotations[2], mirror(arm(right).0)) < 0.1);
            // The forearm is right up to a constant: its own mean of pronation counts as none.
            let offset = arm(left).1.inverse() * read(limbs.rotations[1]);
            offsets.push(2.0 * offset.j.atan2(offset.w));
            prop_assert!(offset.i.hypot(offset.k) < 1e-3);
        }
        let first = offsets[0];
        for offset in offsets {
            prop_assert!((offset - first).sin().abs() < 2e-3 && (offset - first).cos() > 0.9);
        }
    }

}
