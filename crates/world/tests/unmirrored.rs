//! A robot whose right arm does not mirror the left one: each arm has its own geometry.

use follow::arm::{Arm, ArmVector};
use messages::{JOINTS_MAX, Layout, Skeleton, deadline, skeleton_flag};
use nalgebra::{Rotation3, UnitQuaternion};
use rand::{RngExt, SeedableRng};
use retarget::{Config, Input, Limbs, Method, Settings, State, tick};
use robot::limbs::{on_side, place_on_side, xyzw_from_rotation};
use robot::{Frames, Model};

const HERON: &str = include_str!("../../../docs/robots/heron.urdf");

/// Limbs of an arm since the T-pose, and the place of its hand, as those of a left arm, by the kinematics of the whole robot.
fn arm(model: &Model, side: usize, q: &[f64; JOINTS_MAX]) -> (Limbs, nalgebra::Vector3<f64>) {
    let [(now, hand), (straight, _)] = [q, &model.t_pose()].map(|q| {
        let mut frames = Frames::default();
        model.forward(q, &mut frames);
        let torso = model.base_from_torso(&frames).transpose();
        let limbs = model.arms[side].limb_bodies().map(|body| torso * frames.base_from_body[body].r);
        (limbs, place_on_side(side, torso * model.hand_center(&frames, side)))
    });
    let [upper, fore] = [0, 1].map(|limb| {
        let turn = Rotation3::from_matrix_unchecked(now[limb] * straight[limb].transpose());
        on_side(side, &UnitQuaternion::from_rotation_matrix(&turn))
    });
    (Limbs { upper, fore }, hand)
}

#[test]
fn arms_that_do_not_mirror_follow_by_their_own_geometry() {
    // A turned first axis, an elbow 5 cm off, and a narrower range.
    let changes = [("a", "0 1 0\"", "0.2 0.98 0\""), ("d", "0 0 -", "0 0.05 -"), ("e", "=\"2.2\"", "=\"1.9\"")];
    let urdf = changes.iter().fold(HERON.to_owned(), |text, (joint, old, new)| {
        let (before, after) = text.split_at(text.find(&format!("<joint name=\"starboard_{joint}\"")).unwrap());
        format!("{before}{}", after.replacen(old, new, 1))
    });
    let draft = robot::draft("r.urdf", &urdf).unwrap();
    let why = draft.decisions.iter().find(|decision| decision.contains("do not mirror")).expect("a decision");
    assert!(draft.refusals.is_empty() && why.contains("`starboard_a`: deviation of the axis"), "{why}");
    let capsule = "[[collision.capsules]]\nname = \"base\"\nlink = \"floor_plate\"\na_m = [0.0, 0.0, 0.0]\nradius_m = 0.05\n\
                   b_m = [0.0, 0.0, 0.1]\n[collision.allowed]\nadjacent = {}\nproved_clear = {}\n";
    let load = |toml: &str| Model::from_text("r.toml", &format!("{toml}{capsule}"), "r.urdf", &urdf);
    let error = load(&draft.toml.replace("mirrored = false", "")).unwrap_err().to_string();
    assert!(error.contains("`mirrored = false` under [arms]"), "{error}");
    let model = load(&draft.toml).unwrap();
    let settings = Settings { method: Method::ClosedForm, refinement_steps: 10, ..Settings::default() };
    let config = Config::new(&model, None, &settings).unwrap();
    let mut skeleton = Skeleton { flags: skeleton_flag::ALL, ..Skeleton::ZERO };
    let (mut rng, mut before) = (rand_pcg::Pcg64::seed_from_u64(1), model.home);
    for _ in 0..40 {
        let mut q = model.home;
        for own in &model.arms {
            let inside = |i: usize| own.q_min[i] + rng.random_range(0.1..0.9) * (own.q_max[i] - own.q_min[i]);
            own.set_limbs(&[0, 1, 2, 3, 4].map(inside), &mut q);
        }
        let arms = [0, 1].map(|side| arm(&model, side, &q));
        for (side, (limbs, hand)) in arms.iter().enumerate() {
            let (plan, at) = (Arm::from_model(&model, side), |q| ArmVector::from(model.arms[side].limb_values(q)));
            let moved_m = hand - arm(&model, side, &before).1;
            let planned_m = plan.hand_center(&at(&q)) - plan.hand_center(&at(&before));
            assert!((planned_m - moved_m).norm() < 1e-9, "hand {side}: {planned_m} instead of {moved_m}");
            assert!(plan.angles(&at(&q), limbs).iter().all(|angle| *angle < 1e-6), "side {side}");
            let turns = [limbs.upper, limbs.fore].map(|limb| xyzw_from_rotation(&on_side(side, &limb)));
            skeleton.limbs[2 * side..2 * side + 2].copy_from_slice(&turns.map(|turn| turn.map(|x| x as f32)));
        }
        let mut state = State::default();
        let targets = (150..250).map(|i| {
            skeleton.header.sequence += 1;
            (skeleton.received, skeleton.header.origin) = (deadline(10 * i), deadline(10 * i));
            tick(&config, &mut state, deadline(10 * i), Input { k: 10 * i, skeleton: Some(&skeleton) }).target
        });
        let target = targets.last().unwrap();
        for (side, (limbs, _)) in arms.iter().enumerate() {
            let off = arm(&model, side, &target.q).0.angles(limbs);
            assert!(off.iter().all(|angle| angle.to_degrees() < 1.0), "side {side}: {off:?} rad");
        }
        before = q;
    }
}
