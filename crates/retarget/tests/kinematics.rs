//! The arm model, its Jacobian, the closed form, the refinement and the oracle.

use std::f64::consts::FRAC_PI_2;

use crate::support::{arm, random_limbs, random_q};
use nalgebra::{UnitQuaternion, Vector3};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use retarget::{
    ARM_Q, ArmModel, ArmQ, Limbs, PRIOR_WEIGHT, closed_form, features, limb_error_deg, oracle, posture, refine, s_gr,
    slerp,
};

fn worst(arm: &ArmModel, q: &ArmQ, human: &Limbs) -> f64 {
    limb_error_deg(&arm.forward(q), human).into_iter().fold(0.0, f64::max)
}

#[test]
fn forward_kinematics_match_product_of_axis_rotations() {
    let arm = arm();
    let q = [0.3, -0.4, 1.9, 0.7, -1.1];
    let about =
        |axis: Vector3<f64>, angle: f64| UnitQuaternion::from_axis_angle(&nalgebra::Unit::new_unchecked(axis), angle);
    let upper = about(Vector3::z(), -q[0]) * about(Vector3::x(), -q[1]) * about(Vector3::y(), q[2] - FRAC_PI_2);
    let fore = upper * about(Vector3::z(), -q[3]) * about(Vector3::y(), -q[4]);
    assert!(arm.forward(&q).upper.angle_to(&upper) < 1e-12);
    assert!(arm.forward(&q).fore.angle_to(&fore) < 1e-12);
    assert!(worst(&arm, &arm.reference, &Limbs::identity()) < 1e-9, "the reference posture is the T-pose");
    // +q1 forward, +q2 down, +q4 flexes the forearm forward.
    let bone = |q: ArmQ| arm.forward(&q).upper * Vector3::y();
    assert!(bone([0.5, 0.0, 1.57, 0.0, 0.0]).x > 0.4);
    assert!(bone([0.0, 0.5, 1.57, 0.0, 0.0]).z < -0.4);
    assert!((arm.forward(&[0.0, 0.0, arm.reference[2], 0.5, 0.0]).fore * Vector3::y()).x > 0.4);
}

#[test]
fn squared_residual_equals_s_gr() {
    let (arm, mut rng) = (arm(), Pcg64::seed_from_u64(3));
    for _ in 0..1000 {
        let (q, human) = (random_q(&mut rng, &arm), random_limbs(&mut rng));
        let squared: f64 = arm.residual(&q, &human).iter().map(|r| r * r).sum();
        let robot = arm.forward(&q);
        let dots = [robot.upper.coords.dot(&human.upper.coords), robot.fore.coords.dot(&human.fore.coords)];
        let by_definition: f64 = dots.iter().map(|dot| 1.0 - dot * dot).sum();
        assert!((squared - by_definition).abs() < 1e-12);
        assert!((s_gr(&robot, &human) - by_definition).abs() < 1e-12);
    }
}

#[test]
fn jacobian_matches_finite_differences_of_residual() {
    let (arm, mut rng) = (arm(), Pcg64::seed_from_u64(4));
    const STEP: f64 = 1e-6;
    for _ in 0..1000 {
        let (q, human) = (random_q(&mut rng, &arm), random_limbs(&mut rng));
        let at = arm.linearize(&q, &human);
        // At w = 0 the flip makes the residual jump, so no derivative exists there.
        if arm.residual(&q, &human).chunks(3).any(|r| r.iter().map(|x| x * x).sum::<f64>() > 0.9999) {
            continue;
        }
        assert_eq!(at.residual, arm.residual(&q, &human));
        for j in 0..ARM_Q {
            let shifted =
                |by: f64| arm.residual(&std::array::from_fn(|i| if i == j { q[i] + by } else { q[i] }), &human);
            let (plus, minus) = (shifted(STEP), shifted(-STEP));
            for i in 0..6 {
                let difference = (plus[i] - minus[i]) / (2.0 * STEP);
                assert!((difference - at.jacobian[j][i]).abs() < 1e-8, "row {i} column {j}");
            }
        }
    }
}

#[test]
fn closed_form_reaches_every_reachable_posture() {
    let (arm, mut rng) = (arm(), Pcg64::seed_from_u64(5));
    for _ in 0..20_000 {
        let q = random_q(&mut rng, &arm);
        let human = arm.forward(&q);
        let found = closed_form(&arm, &human, &arm.mid());
        assert!(worst(&arm, &found, &human) < 0.05, "{q:?} became {found:?}");
        let near = closed_form(&arm, &human, &q);
        let off = (0..ARM_Q).map(|j| (near[j] - q[j]).abs()).fold(0.0, f64::max);
        assert!(off < 1e-3 || (q[1].abs() - FRAC_PI_2).abs() < 0.05, "{q:?} became {near:?}, {off}");
    }
}

/// A start in the wrong basin costs no more than the margin, whatever the network says.
#[test]
fn posture_from_a_wrong_start_is_at_most_the_margin_worse() {
    const CLEARLY_BETTER: f64 = 0.01;
    let (arm, mut rng) = (arm(), Pcg64::seed_from_u64(13));
    let mut wrong = 0;
    for _ in 0..5000 {
        let (human, start) = (arm.forward(&random_q(&mut rng, &arm)), random_q(&mut rng, &arm));
        let q = posture(&arm, &human, &start, None, 2);
        assert!(arm.s_gr(&q, &human) <= CLEARLY_BETTER, "{start:?} became {q:?}");
        wrong += u32::from(refine(&arm, &human, &start, &start, PRIOR_WEIGHT, 2).s_gr > CLEARLY_BETTER);
        assert_eq!(posture(&arm, &human, &start, None, 0), start, "without steps the network speaks alone");
    }
    assert!(wrong > 1000, "only {wrong} starts were wrong");
}

#[test]
fn closed_form_keeps_joint_1_of_hanging_arm() {
    let arm = arm();
    for q1 in [-1.0, -0.2, 0.0, 0.9] {
        let q = [q1, FRAC_PI_2, 1.2, 0.6, 0.3];
        let found = closed_form(&arm, &arm.forward(&q), &[q1, 1.5, 1.0, 0.5, 0.0]);
        assert!((found[0] - q1).abs() < 1e-9, "joint 1 of {q:?} moved to {}", found[0]);
        assert!(worst(&arm, &found, &arm.forward(&q)) < 0.02);
    }
}

#[test]
fn refinement_never_raises_objective_and_stays_within_limits() {
    let (arm, mut rng) = (arm(), Pcg64::seed_from_u64(6));
    for _ in 0..3000 {
        let (start, prior, human) = (random_q(&mut rng, &arm), random_q(&mut rng, &arm), random_limbs(&mut rng));
        let mut last = f64::INFINITY;
        for steps in 0..8 {
            let end = refine(&arm, &human, &start, &prior, PRIOR_WEIGHT, steps);
            assert!(end.objective <= last, "step {steps} rose from {last} to {}", end.objective);
            assert!((0..ARM_Q).all(|j| (arm.q_min[j]..=arm.q_max[j]).contains(&end.q[j])));
            last = end.objective;
        }
    }
}

#[test]
fn refinement_of_nan_input_gives_finite_posture() {
    let arm = arm();
    let nan =
        Limbs { upper: UnitQuaternion::new_unchecked(nalgebra::Quaternion::from([f64::NAN; 4])), ..Limbs::identity() };
    let start = arm.mid();
    assert_eq!(refine(&arm, &nan, &start, &start, PRIOR_WEIGHT, 3).q, start);
    let end = refine(&arm, &Limbs::identity(), &[f64::NAN; 5], &start, PRIOR_WEIGHT, 3);
    assert!(end.q.iter().all(|q| q.is_finite()));
}

#[test]
fn refinement_from_nearby_finds_posture_in_two_steps() {
    let (arm, mut rng) = (arm(), Pcg64::seed_from_u64(7));
    let mut errors = Vec::new();
    for _ in 0..2000 {
        let q = random_q(&mut rng, &arm);
        let human = arm.forward(&q);
        let start = arm.clamp(&std::array::from_fn(|j| q[j] + rng.random_range(-0.05..0.05)));
        errors.push(worst(&arm, &refine(&arm, &human, &start, &start, PRIOR_WEIGHT, 2).q, &human));
    }
    errors.sort_by(f64::total_cmp);
    assert!(errors[1000] < 0.1, "median {}", errors[1000]);
    assert!(errors[1999] < 1.5, "worst {}", errors[1999]);
}

#[test]
fn oracle_is_never_worse_than_closed_form_and_refinement() {
    let (arm, mut rng) = (arm(), Pcg64::seed_from_u64(8));
    let (mut oracle_sum, mut closed_sum, mut refined_sum) = (0.0, 0.0, 0.0);
    for _ in 0..500 {
        let human = random_limbs(&mut rng);
        let best = oracle(&arm, &human, &arm.mid());
        let closed = closed_form(&arm, &human, &arm.mid());
        let refined = refine(&arm, &human, &closed, &closed, 0.0, 3);
        assert!(best.s_gr <= refined.s_gr + 1e-9);
        assert!((best.s_gr - arm.s_gr(&best.q, &human)).abs() < 1e-12);
        oracle_sum += best.s_gr;
        refined_sum += refined.s_gr;
        closed_sum += arm.s_gr(&closed, &human);
    }
    println!("S_GR sums: oracle {oracle_sum:.3}, closed form + 3 {refined_sum:.3}, closed form {closed_sum:.3}");
    assert!(oracle_sum < refined_sum && refined_sum < closed_sum);
}

#[test]
fn oracle_finds_reachable_postures_exactly() {
    let (arm, mut rng) = (arm(), Pcg64::seed_from_u64(9));
    for _ in 0..300 {
        let human = arm.forward(&random_q(&mut rng, &arm));
        assert!(oracle(&arm, &human, &arm.mid()).s_gr < 1e-10);
    }
}

#[test]
fn slerp_takes_shorter_arc_for_either_sign() {
    let mut rng = Pcg64::seed_from_u64(10);
    for _ in 0..1000 {
        let (a, b) = (random_limbs(&mut rng).upper, random_limbs(&mut rng).upper);
        let minus = UnitQuaternion::new_unchecked(-b.into_inner());
        let angle = |x: &UnitQuaternion<f64>, y: &UnitQuaternion<f64>| x.angle_to(y);
        let third = slerp(&a, &b, 1.0 / 3.0);
        assert!((angle(&a, &third) - angle(&a, &b) / 3.0).abs() < 1e-6);
        assert!(angle(&third, &slerp(&a, &minus, 1.0 / 3.0)) < 1e-6);
        assert!(angle(&slerp(&a, &a, 0.4), &a) < 1e-6);
    }
}

#[test]
fn features_are_bone_and_hinge_axes() {
    let q = UnitQuaternion::from_euler_angles(0.3, -0.8, 1.2);
    let got = features(&Limbs { upper: q, fore: UnitQuaternion::identity() });
    let matrix = q.to_rotation_matrix();
    for i in 0..3 {
        assert!((f64::from(got[i]) - matrix[(i, 1)]).abs() < 1e-6);
        assert!((f64::from(got[3 + i]) + matrix[(i, 2)]).abs() < 1e-6);
    }
    assert_eq!(got[6..], [0.0, 1.0, 0.0, 0.0, 0.0, -1.0]);
}

/// A desk arm: neither limb can roll.
fn desk_arm() -> ArmModel {
    let zero = Vector3::zeros();
    let axes = [Vector3::z(), Vector3::x(), zero, Vector3::z(), zero];
    ArmModel::new(axes, [0.0; ARM_Q], [-1.5, -1.6, 0.0, -2.4, 0.0], [1.5, 1.6, 0.0, 0.3, 0.0])
}

/// An empty slot has no range to normalise a position by.
#[test]
fn weights_of_an_arm_with_empty_slots_are_read_back() {
    let (arm, layers) = (desk_arm(), crate::support::layers(1, 2, 16));
    let (robot, joints) = ("desk".to_owned(), ["a", "b", "", "c", ""].map(str::to_owned));
    let identity = retarget::ArmIdentity { robot, robot_hash: 7, joints, arm };
    let (bytes, text) = retarget::write_weights(&layers, &retarget::Manifest::new(&identity, &layers)).unwrap();
    let weights = retarget::Weights::read(&text, &bytes, &identity).unwrap_or_else(|error| panic!("{error}"));
    assert!(weights.network.decode(&[[0.3; retarget::LATENT]])[0].iter().all(|q| q.is_finite()));
}

#[test]
fn limb_without_roll_is_matched_by_its_direction() {
    let (arm, mut rng) = (desk_arm(), Pcg64::seed_from_u64(15));
    assert_eq!((arm.rolls, arm.has_closed_form), ([false; 2], false));
    for _ in 0..500 {
        let (q, human) = (random_q_within(&mut rng, &arm), random_limbs(&mut rng));
        let robot = arm.forward(&q);
        let bones = [(robot.upper, human.upper), (robot.fore, human.fore)]
            .map(|(a, b)| (a * Vector3::y()).angle(&(b * Vector3::y())).to_degrees());
        let errors = arm.limb_error_deg(&q, &human);
        assert!((0..2).all(|limb| (errors[limb] - bones[limb]).abs() < 1e-5), "{errors:?} {bones:?}");
        let at = arm.linearize(&q, &human);
        for j in 0..ARM_Q {
            let shifted = |by: f64| arm.s_gr(&std::array::from_fn(|i| if i == j { q[i] + by } else { q[i] }), &human);
            let difference = (shifted(1e-6) - shifted(-1e-6)) / 2e-6;
            let gradient: f64 = at.jacobian[j].iter().zip(&at.residual).map(|(a, b)| 2.0 * a * b).sum();
            assert!((difference - gradient).abs() < 1e-6 || bones.iter().any(|deg| *deg > 175.0), "joint {j}");
        }
    }
}

/// Three joints against four numbers of two directions: no posture of a grid is better than what the searches find.
#[test]
fn searches_of_an_arm_without_closed_form_find_the_best_posture() {
    let (arm, mut rng) = (desk_arm(), Pcg64::seed_from_u64(16));
    let at = |j: usize, n: u32| arm.q_min[j] + f64::from(n) / 40.0 * (arm.q_max[j] - arm.q_min[j]);
    let (mut missed, count) = (0, 60);
    for _ in 0..count {
        let human = random_limbs(&mut rng);
        let grid = (0..=40).flat_map(|a| (0..=40).flat_map(move |b| (0..=40).map(move |c| [a, b, c])));
        let least = grid.map(|[a, b, c]| arm.s_gr(&[at(0, a), at(1, b), 0.0, at(3, c), 0.0], &human));
        let least = least.fold(f64::INFINITY, f64::min);
        let best = oracle(&arm, &human, &arm.mid());
        assert!(best.s_gr <= least + 1e-9, "{} instead of {least}", best.s_gr);
        assert!(best.q[2] == 0.0 && best.q[4] == 0.0, "an empty slot stays at zero");
        let found = closed_form(&arm, &human, &arm.mid());
        missed += u32::from(arm.s_gr(&found, &human) > least + 0.01);
    }
    assert!(missed <= count / 20, "{missed} of {count} searches ended elsewhere");
}

fn random_q_within(rng: &mut Pcg64, arm: &ArmModel) -> ArmQ {
    std::array::from_fn(|j| rng.random_range(arm.q_min[j]..=arm.q_max[j]))
}
