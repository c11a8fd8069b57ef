//! Hands that touch.

use retarget::{ArmModel, Limbs, limb_error_deg};
use std::path::Path;
use train::files::read_model;

pub fn arm() -> ArmModel {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/robots/tiago_dual.toml");
    ArmModel::from_model(&read_model(&file).expect("the robot file is valid"), 0)
}

/// A motion of the eleven.
fn named(name: &str) -> motion::Motion {
    poses::motions::paper_motions().into_iter().find(|motion| motion.name == name).expect("the motion")
}

#[test]
fn forearms_of_corrected_arms_that_cross_lie_before_the_torso() {
    let model =
        train::files::read_model(std::path::Path::new("../../config/robots/tiago_dual.toml")).expect("the robot");
    let motion = &named("cross-arms");
    let parts = |first: usize| model.capsules.iter().filter(move |capsule| capsule.body == first);
    let mut least_m = f64::INFINITY;
    for posture in poses::trajectory::ground_truth_touching(&model, motion, 1.0).q {
        let (mut q, mut frames) = (model.home, robot::Frames::default());
        for (arm, posture) in model.arms.iter().zip(posture) {
            arm.set_limbs(&posture, &mut q);
        }
        model.forward(&q, &mut frames);
        for body in model.arms.iter().flat_map(|arm| arm.range().skip(4).map(|joint| joint + 1)) {
            for (part, torso) in parts(body).flat_map(|part| parts(model.torso_body).map(move |torso| (part, torso))) {
                let ([a, b], [c, d]) = (part.ends(&frames), torso.ends(&frames));
                let apart_m = robot::segment_distance(&a, &b, &c, &d).distance_m - part.radius_m - torso.radius_m;
                least_m = least_m.min(apart_m);
            }
        }
    }
    // They were 14 cm inside of it.
    assert!(least_m > 0.0, "{least_m} m");
}

#[test]
fn limbs_of_a_resting_arm_do_not_leap_when_the_other_hand_leaves() {
    let model =
        train::files::read_model(std::path::Path::new("../../config/robots/tiago_dual.toml")).expect("the robot");
    let arm = retarget::ArmModel::from_model(&model, 0);
    let motion = &named("box");
    let calibration = motion::calibrate(motion, motion::CalibrationMode::Rig);
    let people: Vec<_> = motion::limbs(motion, &calibration).iter().filter_map(Limbs::from_message).collect();
    let postures = poses::trajectory::ground_truth_touching(&model, motion, 1.0).q;
    let mut resting = 0;
    for (person, posture) in people.windows(2).zip(postures.windows(2)) {
        let turned = |from: &Limbs, to: &Limbs| limb_error_deg(from, to).into_iter().fold(0.0, f64::max);
        let person_deg = [0, 1].map(|side| turned(&person[0][side], &person[1][side]));
        for side in 0..2 {
            let [from, to] = [0, 1].map(|i| arm.forward(&model.arms[side].mirrored(&posture[i][side])));
            if person_deg[side] < 1e-3 && person_deg[1 - side] > 0.1 {
                resting += 1;
                assert!(turned(&from, &to) < 6.0, "{} degrees in one frame", turned(&from, &to));
            }
        }
    }
    assert!(resting > 50, "{resting}");
}
