//! Tests obstacles around the robot: the refusals, the names in them, and distances against plain sampling.

use crate::support::{LEFT_ARM, RIGHT_ARM, assert_words, shipped};
use nalgebra::{Rotation3, Vector3};
use rand::{RngExt, SeedableRng};
use robot::{BoxEntry, Environment, Frames, PlaneEntry, Solid};

fn floor() -> PlaneEntry {
    PlaneEntry { name: "floor".into(), normal: [0.0, 0.0, 1.0], offset_m: 0.0 }
}

#[test]
fn vectors_of_other_than_three_numbers_are_refused() {
    for normal in ["[0.0, 1.0]", "[0.0, 0.0, 1.0, 7.0]"] {
        let text = format!("[[planes]]\nname = \"floor\"\nnormal = {normal}\noffset_m = 0.0");
        let error = toml::from_str::<Environment>(&text).expect_err(normal).to_string();
        assert!(error.contains("3 numbers") && error.contains("normal"), "{error}");
    }
}

fn table() -> BoxEntry {
    BoxEntry { name: "table".into(), center_m: [1.1, 0.0, 0.73], size_m: [0.8, 1.6, 0.04], rpy_deg: [0.0; 3] }
}

fn refused(environment: &Environment, words: &[&str]) {
    let made = shipped().with_environment("teleop.toml", environment);
    assert_words(made, &[words, &["teleop.toml"]].concat());
}

#[test]
fn obstacle_out_of_bounds_is_refused_with_key_value_and_bound() {
    let planes = |plane: PlaneEntry| Environment { planes: vec![plane], boxes: vec![] };
    let boxes = |block: BoxEntry| Environment { planes: vec![], boxes: vec![block] };
    for (normal, value) in [([0.0, 0.0, 0.9], "0.9"), ([0.0; 3], "0.0"), ([f64::NAN, 0.0, 1.0], "NaN")] {
        refused(&planes(PlaneEntry { normal, ..floor() }), &["environment.planes `floor`: normal", value, "length 1"]);
    }
    for offset_m in [10.5, f64::INFINITY] {
        let value = offset_m.to_string();
        refused(&planes(PlaneEntry { offset_m, ..floor() }), &["offset_m", &value, "at most 10"]);
    }
    let size_m = [0.8, 0.0, 0.04];
    refused(&boxes(BoxEntry { size_m, ..table() }), &["environment.boxes `table`: size_m", "0.0", "0.001 to 20"]);
    refused(&boxes(BoxEntry { center_m: [11.0, 0.0, 0.0], ..table() }), &["center_m", "11.0", "-10 to 10"]);
    refused(&boxes(BoxEntry { rpy_deg: [f64::NAN; 3], ..table() }), &["rpy_deg", "NaN", "-360 to 360"]);
    for (name, value) in [
        (String::new(), "name = \"\"".to_owned()),
        ("x".repeat(65), format!("name = \"{}...\"", "x".repeat(64))),
        ("a\nb".into(), r#"name = "a\nb""#.into()),
        ("\u{1b}[2J\u{7f}\u{9b}".into(), r#"name = "\u{1b}[2J\u{7f}\u{9b}""#.into()),
    ] {
        let words = [&value, "1 to 64 characters, no control characters"];
        refused(&planes(PlaneEntry { name: name.clone(), ..floor() }), &[&words[..], &["environment.planes"]].concat());
        refused(&boxes(BoxEntry { name, ..table() }), &[&words[..], &["environment.boxes"]].concat());
    }
    // Characters are counted, not bytes.
    let long = PlaneEntry { name: "\u{e9}".repeat(64), ..floor() };
    assert!(shipped().with_environment("teleop.toml", &planes(long)).is_ok());
    let twice = Environment { planes: vec![floor()], boxes: vec![BoxEntry { name: "floor".into(), ..table() }] };
    refused(&twice, &["`floor` occurs twice"]);
    let capsule = shipped().capsules[0].name.clone();
    refused(&boxes(BoxEntry { name: capsule.clone(), ..table() }), &[&capsule, "occurs twice"]);
    let many = (0..9).map(|i| PlaneEntry { name: i.to_string(), ..floor() }).collect();
    refused(&Environment { planes: many, boxes: vec![] }, &["environment.planes: 9, at most 8"]);
    // The floor is at the height of the waist.
    refused(
        &planes(PlaneEntry { offset_m: 0.8, ..floor() }),
        &["environment `floor`: clearance", "at home", "-", "mm"],
    );
}

#[test]
fn obstacles_follow_capsules_in_names_and_keep_robot_hash() {
    let environment = Environment { planes: vec![floor()], boxes: vec![table()] };
    let (plain, model) = (shipped(), shipped().with_environment("teleop.toml", &environment).expect("clear"));
    assert_eq!((plain.hash, plain.obstacles.len(), model.obstacles.len()), (model.hash, 0, 2), "weights stay valid");
    let count = model.capsules.len() as u32;
    let names = [0, count - 1, count, count + 1, count + 2].map(|index| model.shape_name(index));
    assert_eq!(names, [&*model.capsules[0].name, &*model.capsules[count as usize - 1].name, "floor", "table", "?"]);
    let mut frames = Frames::default();
    // The T-pose, with the torso low and high, is clear of the floor and of the table.
    let mut q = model.t_pose();
    for lift in [model.limits[0].q_min, model.limits[0].q_max] {
        q[0] = lift;
        model.forward(&q, &mut frames);
        let (clearance_m, _) = model.obstacle_clearance(&frames);
        assert!(clearance_m > 0.05, "{clearance_m} at lift {lift}");
    }
}

#[test]
fn torso_lift_changes_clearance_of_arms_from_table() {
    let model = shipped().with_environment("teleop.toml", &Environment { planes: vec![], boxes: vec![table()] });
    let model = model.expect("clear");
    let mut frames = Frames::default();
    let mut q = model.home;
    // Both forearms reach forward over the table.
    for arm in [LEFT_ARM, RIGHT_ARM] {
        arm.zip([1.2, 0.6, 1.5, 1.0, 0.0, 0.0, 0.0]).for_each(|(j, position)| q[j] = position);
    }
    let at = [0.1, 0.2].map(|lift| {
        q[0] = lift;
        model.forward(&q, &mut frames);
        model.obstacle_clearance(&frames).0
    });
    assert!((at[1] - at[0]).abs() > 0.02, "{at:?}");
}

#[test]
fn box_distances_match_samples() {
    let mut rng = rand_pcg::Pcg64::seed_from_u64(1);
    for n in 0..2000 {
        let mut point = |size: f64| Vector3::from_fn(|_, _| rng.random_range(-size..size));
        let (r, center, half_m) = (Rotation3::new(point(3.0)), point(0.5), point(0.4).abs() + Vector3::repeat(0.01));
        let (a, b) = (point(1.0), point(1.0));
        let solid = Solid::Box { center, r: r.into_inner(), half_m };
        let exact = solid.segment_distance(&a, &b);
        let mut sampled = f64::INFINITY;
        for i in 0..=1000 {
            let x = r.inverse() * (a + (b - a) * (f64::from(i) / 1000.0) - center);
            sampled = sampled.min((x - x.zip_map(&half_m, |x, half| x.clamp(-half, half))).norm());
        }
        // Between samples the distance changes by at most half a step.
        assert!(exact <= sampled + 1e-12 && exact >= sampled - (b - a).norm() / 2000.0, "{n}: {exact} {sampled}");
    }
}
