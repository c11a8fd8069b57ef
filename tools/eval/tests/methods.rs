//! The methods of this tool: the closed form by shoulder, elbow and wrist, and hands that touch.

use eval::sew::sew;
use nalgebra::{Quaternion, UnitQuaternion};
use rand::RngExt;
use rand_pcg::Pcg64;
use retarget::{ArmModel, ArmQ, Limbs, closed_form, limb_error_deg};
use std::path::Path;
use train::files::read_model;

fn arm() -> ArmModel {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/robots/tiago_dual.toml");
    ArmModel::from_model(&read_model(&file).expect("the robot file is valid"))
}

fn posture(arm: &ArmModel, rng: &mut Pcg64) -> ArmQ {
    std::array::from_fn(|j| rng.random_range(arm.q_min[j]..arm.q_max[j]))
}

/// Draws a rotation from a cube of quaternions. Any rotation is possible, but the distribution is not quite uniform.
fn rotation(rng: &mut Pcg64) -> UnitQuaternion<f64> {
    let mut next = || rng.random_range(-1.0..1.0);
    UnitQuaternion::new_normalize(Quaternion::new(next(), next(), next(), next()))
}

#[test]
fn sew_is_exact_for_poses_that_the_arm_can_reach() {
    let arm = arm();
    let mut rng = Pcg64::new(1, 1);
    let mut exact = 0;
    for _ in 0..2_000 {
        let human = arm.forward(&posture(&arm, &mut rng));
        let q = sew(&arm, &human, &arm.mid());
        let s = arm.s_gr(&q, &human);
        // A branch that is worse by less than 0.1 degrees, sin^2(0.05 deg), may win because it is nearer.
        assert!(s < 7.7e-7, "{s} at {q:?}");
        exact += i32::from(s < 1e-12);
    }
    assert!(exact > 1_980, "{exact}");
}

#[test]
fn sew_of_turned_poses_keeps_limits_and_beats_closed_form() {
    let arm = arm();
    let mut rng = Pcg64::new(2, 1);
    let (mut ours, mut simple) = (0.0, 0.0);
    for _ in 0..2_000 {
        // Beyond the limits, but within human motion: a reachable pose, turned.
        let near = arm.forward(&posture(&arm, &mut rng));
        let turn = UnitQuaternion::identity().slerp(&rotation(&mut rng), 0.3);
        let human = Limbs { upper: turn * near.upper, fore: turn * near.fore };
        let q = sew(&arm, &human, &arm.mid());
        assert!(q.iter().zip(arm.q_min.iter().zip(&arm.q_max)).all(|(q, (low, high))| (*low..=*high).contains(q)));
        ours += arm.s_gr(&q, &human);
        simple += arm.s_gr(&closed_form(&arm, &human, &arm.mid()), &human);
    }
    assert!(ours < simple, "{ours} {simple}");
}

fn loaded() -> config::Loaded {
    config::load(std::path::Path::new("../../config/teleop.toml"), config::Overrides::default()).expect("settings")
}

/// A motion of the eleven.
fn named(name: &str) -> motion::Motion {
    poses::motions::paper_motions().into_iter().find(|motion| motion.name == name).expect("the motion")
}

#[test]
fn boxers_fists_are_commanded_near_head_and_each_other() {
    let mut loaded = loaded();
    loaded.settings.retarget.contact_weight = 1.0;
    let motion = &named("box");
    let played = eval::contacts::Played::new(&loaded, motion, 1.0).expect("it is played");
    let [commanded, held] = played.commands(&loaded.model);
    let mean_m = |errors: eval::contacts::Errors| errors.mean_m().expect("a contact");
    // Limbs that were corrected, without the hands' own places: 3.2, 5.8 and 7.2 cm.
    let found_m = [commanded.head, commanded.hands, held.hands].map(mean_m);
    assert!(found_m[0] < 0.02 && found_m[1] < 0.04 && found_m[2] < 0.03, "{found_m:?} m");
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
fn optimum_of_contacts_reaches_slow_ones_and_misses_fast_ones() {
    let loaded = loaded();
    let mut chest_m = None;
    let mut excess_m = |name: &str| {
        let motion = &named(name);
        let played = eval::contacts::Played::new(&loaded, motion, 1.0).expect("it is played");
        let postures = eval::contacts::postures(&loaded.model, motion, 1.0);
        let mean_m = |contacts: eval::contacts::Contacts| contacts.hands.mean_m().expect("hands that touch");
        let optimum = played.optimum(&loaded.model);
        chest_m = optimum.chest.mean_m();
        let optimum_m = mean_m(optimum);
        assert!(name != "cross-arms" || optimum_m > 0.03, "{optimum_m} m");
        optimum_m - mean_m(postures)
    };
    let [clap_m, cross_m, box_m] = ["clap", "cross-arms", "box"].map(&mut excess_m);
    assert!(clap_m.abs() < 0.005, "{clap_m} m");
    // The best for limbs alone misses by 3.5 cm more.
    assert!(box_m.abs() < 0.01, "{box_m} m");
    // A search that begins at the best for limbs alone misses by 5 cm.
    assert!(chest_m.is_some_and(|chest_m| chest_m < 0.025), "{chest_m:?} m");
    // Hands that pass each other: 2.9 cm.
    assert!(cross_m > 0.02, "{cross_m} m");
}

#[test]
fn limbs_of_a_resting_arm_do_not_leap_when_the_other_hand_leaves() {
    let model =
        train::files::read_model(std::path::Path::new("../../config/robots/tiago_dual.toml")).expect("the robot");
    let arm = retarget::ArmModel::from_model(&model);
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

#[test]
fn contacts_count_where_the_person_touches() {
    let motions = poses::motions::paper_motions();
    // What the arms reach: RB-Y1's hands on its head and G1's crossed arms are the worst.
    for (robot, reached_m) in [("tiago_dual", 0.03), ("unitree_g1", 0.06), ("rby1a", 0.05)] {
        let path = format!("../../config/robots/{robot}.toml");
        let model = train::files::read_model(std::path::Path::new(&path)).expect("the robot");
        let mut worst_m = [0.0_f64; 2];
        for (motion, weight) in motions.iter().flat_map(|motion| [(motion, 0.0), (motion, 1.0)]) {
            let contacts = eval::contacts::postures(&model, motion, weight);
            for errors in [contacts.head, contacts.chest, contacts.hands] {
                let worst = &mut worst_m[usize::from(weight > 0.0)];
                *worst = errors.mean_m().map_or(*worst, |mean_m| mean_m.max(*worst));
                assert!(errors.mean_m().is_none_or(|mean_m| mean_m <= errors.max_m), "{errors:?}");
            }
            let touches = contacts != eval::contacts::Contacts::default();
            assert!(!touches || motion.name != "t-pose", "nothing touches: {contacts:?}");
        }
        let [limbs_m, corrected_m] = worst_m;
        assert!(
            limbs_m > 0.15 && corrected_m < reached_m,
            "{robot}: limbs alone {limbs_m} m, corrected {corrected_m} m"
        );
    }
}
