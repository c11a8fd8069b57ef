//! The kinematics of the limbs and the Jacobian of their error, compared with the robot's kinematics and finite
//! differences.

use crate::support::{arm, model, random_q, turned};
use follow::LIMB_JOINTS;
use follow::arm::{Arm, ArmVector, Limbs};
use nalgebra::{UnitQuaternion, Vector3};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use robot::Frames;
use std::f64::consts::PI;

#[test]
fn limb_rotations_match_robot_kinematics() {
    let (model, mut rng) = (model(), Pcg64::seed_from_u64(1));
    let of_model = Arm::from_model(&model, 0);
    for _ in 0..1000 {
        let q = random_q(&mut rng);
        let (upper, fore) = model.arms[0].limb_rotations(&std::array::from_fn(|j| q[j]));
        let limbs = of_model.limbs(&q);
        assert!((limbs.upper.to_rotation_matrix().matrix() - upper).amax() < 1e-12);
        assert!((limbs.fore.to_rotation_matrix().matrix() - fore).amax() < 1e-12);
    }
}

/// Largest difference between the Jacobian's entries and central differences, over steps of 1e-6 rad.
fn jacobian_off(arm: &Arm, q: &ArmVector, person: &Limbs) -> f64 {
    const STEP: f64 = 1e-6;
    let error = arm.error(q, person);
    let mut worst = 0.0_f64;
    for j in 0..LIMB_JOINTS {
        let at = |by: f64| {
            let mut q = *q;
            q[j] += by;
            arm.error(&q, person).rotation
        };
        let (after, before) = (at(STEP), at(-STEP));
        for (row, (after, before)) in after.iter().zip(&before).enumerate() {
            worst = worst.max((error.jacobian[j][row] - (after - before) / (2.0 * STEP)).abs());
        }
    }
    worst
}

/// Postures anywhere, at the gimbal and with the elbow straight.
fn posture(rng: &mut Pcg64, case: u32) -> ArmVector {
    let mut q = random_q(rng);
    match case % 3 {
        0 => q[1] = PI / 2.0 + rng.random_range(-1e-4..1e-4),
        1 => q[3] = rng.random_range(-1e-7..1e-7),
        _ => {}
    }
    q
}

#[test]
fn jacobian_matches_differences_at_errors_from_zero_to_pi() {
    let (arm, mut rng) = (arm(), Pcg64::seed_from_u64(3));
    // At 1e-6 the logarithm changes its formula: steps lie on both sides of it.
    for angle in [0.0, 1e-9, 9.9e-7, 1e-6, 2e-6, 2.1e-6, 1e-4, 0.5, 2.0, PI - 1e-2, PI - 1e-3, PI - 1e-4] {
        for case in 0..300 {
            let q = posture(&mut rng, case);
            let limbs = arm.limbs(&q);
            let mut from = |limb: &UnitQuaternion<f64>| turned(&mut rng, limb, angle);
            let person = Limbs { upper: from(&limbs.upper), fore: from(&limbs.fore) };
            for missing in arm.angles(&q, &person) {
                assert!((missing - angle).abs() < 1e-7, "{missing} rad instead of {angle}");
            }
            let off = jacobian_off(&arm, &q, &person);
            // The Jacobian's own curvature is of order one. For numbers of order pi, differences keep 1e-9.
            assert!(off < 2e-8, "{angle} rad, case {case}: {off}");
        }
    }
}

#[test]
fn limb_error_is_zero_at_own_posture_and_ignores_sign() {
    let (arm, mut rng) = (arm(), Pcg64::seed_from_u64(4));
    for _ in 0..500 {
        let (q, other) = (random_q(&mut rng), random_q(&mut rng));
        let error = arm.error(&q, &arm.limbs(&q));
        assert!(error.rotation.iter().all(|x| x.abs() < 1e-14), "{:?}", error.rotation);
        // Joints 4 and 5 do not turn the upper arm.
        assert!((3..LIMB_JOINTS).all(|j| error.jacobian[j][..3] == [0.0; 3]));
        let person = arm.limbs(&other);
        let negated = |limb: UnitQuaternion<f64>| UnitQuaternion::new_unchecked(-limb.into_inner());
        let same = Limbs { upper: negated(person.upper), fore: negated(person.fore) };
        assert_eq!(arm.error(&q, &person).rotation, arm.error(&q, &same).rotation);
        // The angles are the lengths of the error's rotations, and these turn the person into the robot.
        let error = arm.error(&q, &person).rotation;
        for (limb, angle) in arm.angles(&q, &person).into_iter().enumerate() {
            let missing = Vector3::from_column_slice(&error[3 * limb..3 * limb + 3]);
            assert!((missing.norm() - angle).abs() < 1e-12);
            let [robot, person] = [arm.limbs(&q), person].map(|l| if limb == 0 { l.upper } else { l.fore });
            assert!((UnitQuaternion::from_scaled_axis(missing) * person).angle_to(&robot) < 1e-7);
        }
    }
}

#[test]
fn hand_is_that_of_the_robot_and_its_derivative_matches_central_differences() {
    const STEP: f64 = 1e-6;
    let (model, mut rng) = (model(), Pcg64::seed_from_u64(5));
    let arm = Arm::from_model(&model, 0);
    let place = |q: &ArmVector| {
        let (mut all, mut frames) = (model.home, Frames::default());
        model.arms[0].set_limbs(&(*q).into(), &mut all);
        model.forward(&all, &mut frames);
        model.hand_center(&frames, 0)
    };
    for _ in 0..500 {
        let (q, other) = (random_q(&mut rng), random_q(&mut rng));
        let moved_m = arm.hand_center(&q) - arm.hand_center(&other);
        assert!((moved_m - (place(&q) - place(&other))).norm() < 1e-9, "{moved_m}");
        let (hand, jacobian) = arm.hand_jacobian(&q);
        assert_eq!(hand, arm.hand_center(&q));
        for (j, by_joint) in jacobian.iter().enumerate() {
            let [after, before] = [STEP, -STEP].map(|by| {
                let mut q = q;
                q[j] += by;
                arm.hand_center(&q)
            });
            assert!((by_joint - (after - before) / (2.0 * STEP)).norm() < 1e-8, "joint {j}");
        }
    }
}

/// A limb that cannot roll is matched by its direction: the error is the angle between both bones, whatever the roll of the
/// person, and the gradient of its square is that of differences.
#[test]
fn limb_without_roll_is_matched_by_its_direction() {
    let (x, y, zero) = (Vector3::x(), Vector3::y(), Vector3::zeros());
    let arm = Arm::new([Vector3::z(), x, zero, Vector3::z(), zero], [0.0; LIMB_JOINTS], [y * 0.3; LIMB_JOINTS]);
    let mut rng = Pcg64::seed_from_u64(9);
    for _ in 0..500 {
        let mut random = || ArmVector::from_fn(|j, _| if j == 2 || j == 4 { 0.0 } else { rng.random_range(-2.0..2.0) });
        let (q, other) = (random(), random());
        let rolled = |limb: UnitQuaternion<f64>, by: f64| limb * UnitQuaternion::new(y * by);
        let goal = arm.limbs(&other);
        let person = Limbs { upper: rolled(goal.upper, 1.1), fore: rolled(goal.fore, -0.7) };
        assert!(arm.angles(&other, &person).iter().all(|angle| angle.abs() < 1e-7));
        let robot = arm.limbs(&q);
        let bones = [(robot.upper, person.upper), (robot.fore, person.fore)].map(|(a, b)| (a * y).angle(&(b * y)));
        let angles = arm.angles(&q, &person);
        assert!((0..2).all(|limb| (angles[limb] - bones[limb]).abs() < 1e-7), "{angles:?} {bones:?}");
        let half_square = |q: &ArmVector| arm.error(q, &person).rotation.iter().map(|x| x * x).sum::<f64>() / 2.0;
        let error = arm.error(&q, &person);
        for j in 0..LIMB_JOINTS {
            let at = |by: f64| half_square(&ArmVector::from_fn(|i, _| q[i] + if i == j { by } else { 0.0 }));
            let difference = (at(1e-6) - at(-1e-6)) / 2e-6;
            let gradient: f64 = error.jacobian[j].iter().zip(&error.rotation).map(|(a, b)| a * b).sum();
            assert!((difference - gradient).abs() < 1e-6 || bones.iter().any(|angle| *angle > 3.1), "joint {j}");
        }
    }
}
