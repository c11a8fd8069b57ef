//! Two independent readers of the same files read the same robot.

use crate::support::{ARMS, GRIPPERS, HANDS, JOINTS, body, uniform};
use plant::{Body, Frames, JointKind, Options};
use rand::SeedableRng;
use robot::Model;

fn both(texts: [&str; 4]) -> (Body, Model) {
    let [toml_name, toml, urdf_name, urdf] = texts;
    (body(texts), Model::from_text(toml_name, toml, urdf_name, urdf).unwrap())
}

#[test]
fn limits_home_and_names_match_robot_crate() {
    for texts in [HANDS, GRIPPERS] {
        let (body, model) = both(texts);
        assert_eq!(body.home, model.home);
        for j in 0..JOINTS {
            let joint = &body.joints[j];
            assert_eq!(joint.name, model.joint_names[j]);
            assert_eq!(joint.kind == JointKind::Prismatic, model.prismatic[j]);
            for (own, other) in [(&joint.urdf, &model.urdf_limits[j]), (&joint.limits, &model.limits[j])] {
                let own = [own.q_min, own.q_max, own.v_max, own.a_max, own.j_max, own.effort_max];
                let other = [other.q_min, other.q_max, other.v_max, other.a_max, other.j_max, other.effort_max];
                assert_eq!(own, other, "{}: {}", texts[0], joint.name);
            }
        }
    }
}

#[test]
fn payloads_match_robot_crate() {
    for texts in [HANDS, GRIPPERS] {
        let laden = texts[1].replace("mass_kg = 0.0", "mass_kg = 0.7");
        let (body, model) = both([texts[0], &laden, texts[2], texts[3]]);
        let empty = plant::Config::from_text(texts[0], texts[1], texts[2], texts[3], &Options::default()).unwrap();
        let config = plant::Config::new(body.clone(), &Options::default()).unwrap();
        let laden = Options { hands_kg: [Some(0.7), Some(0.7)], ..Options::default() };
        let laden = plant::Config::from_text(texts[0], texts[1], texts[2], texts[3], &laden).unwrap();
        let inertias = model.inertias();
        for (side, arm) in ARMS.into_iter().enumerate() {
            let (last, payload) = (arm.end, model.payload[side].unwrap());
            assert_eq!(body.payloads[side], Some((payload.mass_kg, payload.center)));
            let theirs = inertias[last].combined(&robot::Inertia::point(payload.mass_kg, payload.center));
            for own in [&config, &laden].map(|config| &config.body().inertias[last]) {
                assert!((own.mass_kg - theirs.mass_kg).abs() < 1e-12);
                assert!((own.moment - theirs.center * theirs.mass_kg).amax() < 1e-12);
                assert!((own.about_origin - theirs.about(&nalgebra::Vector3::zeros())).amax() < 1e-12);
            }
            assert!((empty.body().inertias[last].mass_kg - inertias[last].mass_kg).abs() < 1e-12);
        }
    }
}

#[test]
fn capsules_pairs_and_minimum_clearance_match_robot_crate() {
    for texts in [HANDS, GRIPPERS] {
        let (body, model) = both(texts);
        assert_eq!(body.d_min_m, model.d_min_m);
        assert_eq!(body.capsules.len(), model.capsules.len());
        for (own, other) in body.capsules.iter().zip(&model.capsules) {
            assert_eq!((&own.name, own.body, own.radius_m), (&other.name, other.body, other.radius_m));
            let off = (own.ends[0] - other.a).amax().max((own.ends[1] - other.b).amax());
            assert!(off <= 1e-12, "{}: {off}", own.name);
        }
        let theirs: Vec<[usize; 2]> = model.pairs.iter().map(|pair| [pair.a, pair.b]).collect();
        assert_eq!(body.pairs, theirs);
        assert!(body.pairs.len() > 100, "{}", body.pairs.len());
    }
}

#[test]
fn frames_and_clearance_of_random_postures_match_robot_crate() {
    for texts in [HANDS, GRIPPERS] {
        let (body, model) = both(texts);
        let config = plant::Config::new(body, &plant::Options::default()).unwrap();
        let mut judge = plant::Judge::new(&config, config.home());
        let mut rng = rand_pcg::Pcg64::seed_from_u64(2);
        let (mut ours, mut theirs) = (Frames::default(), robot::Frames::default());
        for _ in 0..10_000 {
            let q = uniform(config.body(), &mut rng);
            config.body().forward(&q, &mut ours);
            model.forward(&q, &mut theirs);
            for (own, other) in ours.base_from_body.iter().zip(&theirs.base_from_body) {
                let off = (own.r - other.r).amax().max((own.t - other.t).amax());
                assert!(off <= 1e-12, "{}: {off}", texts[0]);
            }
            let (ours, theirs) = (judge.clearance(&config, &q), model.clearance(&theirs));
            assert!((ours.0 - theirs.0).abs() <= 1e-9, "{}: {ours:?} {theirs:?}", texts[0]);
        }
    }
}

#[test]
fn raised_base_matches_robot_crate() {
    let base = "base_link = \"base_footprint\"\n";
    let toml = HANDS[1].replace(base, &format!("{base}base_height_m = 0.4\n"));
    let (body, model) = both([HANDS[0], &toml, HANDS[2], HANDS[3]]);
    let (mut ours, mut theirs) = (Frames::default(), robot::Frames::default());
    body.forward(&body.home, &mut ours);
    model.forward(&model.home, &mut theirs);
    for (own, other) in ours.base_from_body.iter().zip(&theirs.base_from_body) {
        assert!((own.t - other.t).amax() < 1e-12, "{own:?} {other:?}");
    }
    let base = |capsule: &plant::Capsule| capsule.body == 0;
    let (own, other) = (body.capsules.iter().find(|one| base(one)), model.capsules.iter().find(|one| one.body == 0));
    let (own, other) = (own.expect("a base"), other.expect("a base"));
    assert!((own.ends[0] - other.a).amax() < 1e-12, "{own:?} {other:?}");
}
