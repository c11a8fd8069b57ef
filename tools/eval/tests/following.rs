//! `eval --following`: the sign of the delay, and the command on a short motion.

use crate::command::{folder, root};
use clap::Parser;
use eval::cli::Cli;
use eval::following::{Person, Played, Sample, judge};
use eval::run::run;
use messages::{Layout, Skeleton, Stamp, skeleton_flag};
use retarget::{ArmModel, ArmQ, mirror, xyzw_from_rotation};
use robot::Model;
use serde_json::Value;
use train::files::read_model;

fn model() -> Model {
    read_model(&root().join("config/robots/tiago_dual.toml")).expect("the robot of the repository")
}

/// Every joint oscillates about the middle of its range, with a speed of at most `speed` rad/s and its own phase.
fn swing(arm: &ArmModel, t_s: f64, speed: f64) -> ArmQ {
    let pace = 2.0;
    std::array::from_fn(|j| arm.mid()[j] + speed / pace * (pace * t_s + j as f64).sin())
}

const BEGIN_NS: u64 = 5_000_000_000;

/// A person with the limbs of that oscillation, seen at 60 Hz for `seconds`.
fn person(arm: &ArmModel, seconds: f64, speed: f64) -> Person {
    let mut person = Person::default();
    for i in 0..(seconds * 60.0) as u64 {
        let mut skeleton = Skeleton { flags: skeleton_flag::ALL, ..Skeleton::ZERO };
        skeleton.header.origin = Stamp(BEGIN_NS + i * 1_000_000_000 / 60);
        let limbs = arm.forward(&swing(arm, i as f64 / 60.0, speed));
        let left = [limbs.upper, limbs.fore].map(|limb| xyzw_from_rotation(&limb));
        let all = [left[0], left[1], mirror(left[0]), mirror(left[1])];
        skeleton.limbs = all.map(|limb| limb.map(|x| x as f32));
        person.add(&skeleton);
    }
    person
}

#[test]
fn late_robot_has_small_error_only_at_its_own_delay() {
    let arm = ArmModel::from_model(&model(), 0);
    let at = |i: u64| Stamp(BEGIN_NS + 1_000_000_000 + i * 20_000_000);
    for (late_s, sign) in [(0.12, 1.0), (0.0, 0.0), (-0.12, -1.0)] {
        let sample = |i: u64| {
            let q = swing(&arm, 1.0 + i as f64 * 0.02 - late_s, 1.5);
            Sample { at: at(i), q: [q; 2] }
        };
        let spans = vec![(0..100).map(sample).collect(), (150..200).map(sample).collect()];
        let played = Played { person: person(&arm, 6.0, 1.5), spans, ticks: 1, ..Played::default() };
        let figures = judge([&arm; 2], &played, &[60.0, 120.0, 200.0]).expect("figures");
        let right = |deg: f64| deg < 0.1;
        assert_eq!(right(figures.at_deg[1]), sign > 0.0, "{late_s} s: {figures:?}");
        assert_eq!(right(figures.now_deg), sign == 0.0, "{late_s} s: {figures:?}");
        assert!(figures.at_deg.iter().chain([&figures.now_deg]).filter(|deg| right(**deg)).count() <= 1);
        assert_eq!(figures.best_ms, if sign > 0.0 { 120.0 } else { 0.0 }, "{figures:?}");
        // A larger distance in time gives a larger error.
        assert!(figures.at_deg[2] > figures.at_deg[1] || sign > 0.0);
    }
}

#[test]
fn following_error_is_the_mean_angle_of_four_limbs() {
    let arm = ArmModel::from_model(&model(), 0);
    let rest = arm.mid();
    let mut bent = rest;
    bent[3] += 0.2;
    let spans = vec![vec![Sample { at: Stamp(BEGIN_NS), q: [bent, rest] }]];
    let played = Played { person: person(&arm, 1.0, 0.0), spans, ticks: 1, ..Played::default() };
    let figures = judge([&arm; 2], &played, &[0.0]).expect("figures");
    // One forearm of four limbs is off by 0.2 rad.
    assert!((figures.now_deg - 0.2_f64.to_degrees() / 4.0).abs() < 1e-3, "{figures:?}");
}

#[test]
fn following_command_writes_every_figure_of_a_motion() {
    let folder = folder(&["short"], 120);
    let path = |name: &str| folder.path().join(name).display().to_string();
    let (json, config) = (path("out.json"), root().join("config/teleop.toml").display().to_string());
    let from = path("");
    let words = ["eval", "--following", &from, "--config", &config, "--calibration", "rig", "--delay-ms", "100"];
    run(&Cli::parse_from(words.into_iter().chain(["--json", &json]))).expect("the command succeeds");
    let out: Value = serde_json::from_str(&std::fs::read_to_string(&json).expect("the file")).expect("JSON");
    let clip = &out["clips"][0];
    let number = |key: &str| clip[key].as_f64().unwrap_or_else(|| panic!("{key}: {clip:#}"));
    assert_eq!((&clip["clip"], &clip["stopped"]), (&Value::from("short"), &Value::Null));
    assert!((1.9..2.2).contains(&number("seconds")), "{clip:#}");
    assert_eq!(clip["at_ms_deg"].as_object().map(serde_json::Map::len), Some(3), "60, 100 and 200 ms");
    assert_eq!(clip["at_ms_deg"]["100"], clip["at_delay_deg"]);
    assert!(number("best_deg") <= number("now_deg") && number("now_deg") < 90.0, "{clip:#}");
    assert!((0.01..1.0).contains(&number("torque_share_max")) && (0.0..=1.0).contains(&number("on_plan_share")));
    let violations = clip["violations"].as_object().expect("kinds");
    assert!(violations.len() >= 12 && violations.values().all(|count| *count == 0), "{violations:?}");
    assert_eq!(out["mean"]["now_deg"], clip["now_deg"]);
}
