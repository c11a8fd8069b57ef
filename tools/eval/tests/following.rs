//! `eval --following`: the sign of the delay, the optimum against known motions, and the command on a short motion.

use crate::command::root;
use clap::Parser;
use eval::cli::Cli;
use eval::following::optimum::{least_squares, optimum};
use eval::following::{Joints, Motion, NODE_S, Person, Played, Sample, bounds_of, judge};
use eval::run::run;
use follow::solver::{Bounds, State};
use messages::{Layout, Skeleton, Stamp, skeleton_flag};
use retarget::{ARM_Q, ArmModel, ArmQ, Limbs, limb_error_deg, mirror, xyzw_from_rotation};
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
    let arm = ArmModel::from_model(&model());
    let at = |i: u64| Stamp(BEGIN_NS + 1_000_000_000 + i * 20_000_000);
    for (late_s, sign) in [(0.12, 1.0), (0.0, 0.0), (-0.12, -1.0)] {
        let sample = |i: u64| {
            let q = swing(&arm, 1.0 + i as f64 * 0.02 - late_s, 1.5);
            Sample { at: at(i), q: [q; 2], v: [[0.0; ARM_Q]; 2] }
        };
        let spans = vec![(0..100).map(sample).collect(), (150..200).map(sample).collect()];
        let played = Played { person: person(&arm, 6.0, 1.5), spans, ticks: 1, ..Played::default() };
        let figures = judge(&arm, &played, &[60.0, 120.0, 200.0], None).expect("figures");
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
    let arm = ArmModel::from_model(&model());
    let rest = arm.mid();
    let mut bent = rest;
    bent[3] += 0.2;
    let spans = vec![vec![Sample { at: Stamp(BEGIN_NS), q: [bent, rest], v: [[0.0; ARM_Q]; 2] }]];
    let played = Played { person: person(&arm, 1.0, 0.0), spans, ticks: 1, ..Played::default() };
    let figures = judge(&arm, &played, &[0.0], None).expect("figures");
    // One forearm of four limbs is off by 0.2 rad.
    assert!((figures.now_deg - 0.2_f64.to_degrees() / 4.0).abs() < 1e-3, "{figures:?}");
}

/// Returns the mean angle of both limbs over the nodes after the start, degrees.
fn error(arm: &ArmModel, motion: &Motion, path: &[Limbs]) -> f64 {
    assert_eq!(motion.states.len() + 1, path.len());
    let nodes = motion.states.iter().zip(&path[1..]);
    let sum: f64 = nodes.map(|(s, goal)| limb_error_deg(&arm.forward(&s.q.into()), goal).iter().sum::<f64>()).sum();
    sum / (2.0 * motion.states.len() as f64)
}

/// Checks that a motion is consistent and keeps the limits.
fn assert_feasible(motion: &Motion, start: State, bounds: &Bounds) {
    let mut at = start;
    for (k, (a, state)) in motion.a.iter().zip(&motion.states).enumerate() {
        at = State { q: at.q + at.v * NODE_S + a * (0.5 * NODE_S * NODE_S), v: at.v + a * NODE_S };
        assert!((at.q - state.q).amax() < 1e-9 && (at.v - state.v).amax() < 1e-9, "node {k}");
        for j in 0..ARM_Q {
            let inside = bounds.q_min[j] - 2e-3..=bounds.q_max[j] + 2e-3;
            assert!(inside.contains(&state.q[j]), "node {k}, joint {j}: {}", state.q[j]);
            assert!(a[j].abs() <= bounds.a_max[j] && state.v[j].abs() <= bounds.v_max[j], "node {k}, joint {j}");
        }
    }
}

fn path(arm: &ArmModel, speed: f64) -> Vec<Limbs> {
    (0..150).map(|k| arm.forward(&swing(arm, f64::from(k) * NODE_S, speed))).collect()
}

fn starting(arm: &ArmModel, speed: f64) -> State {
    let ahead = swing(arm, 1e-6, speed);
    let q = swing(arm, 0.0, speed);
    State { q: Joints::from(q), v: (Joints::from(ahead) - Joints::from(q)) * 1e6 }
}

#[test]
fn optimum_of_a_feasible_path_follows_it() {
    let model = model();
    let arm = ArmModel::from_model(&model);
    for bounds in bounds_of(&model) {
        let speed = 0.9 * bounds.v_max.iter().chain(&bounds.a_max.map(|a| a / 2.0)).fold(f64::MAX, |a, b| a.min(*b));
        let (start, path) = (starting(&arm, speed), path(&arm, speed));
        let motion = optimum(&arm, &bounds, &path, start);
        assert_feasible(&motion, start, &bounds);
        assert!(error(&arm, &motion, &path) < 0.1, "{} degrees", error(&arm, &motion, &path));
    }
}

#[test]
fn optimum_of_too_fast_path_is_no_worse_than_known_motions() {
    let model = model();
    let (arm, [bounds, _]) = (ArmModel::from_model(&model), bounds_of(&model));
    for speed in [1.0, 1.5, 2.0] {
        let path = path(&arm, speed);
        let start = State { v: Joints::zeros(), ..starting(&arm, speed) };
        // Known motion: standing still.
        let still = Motion::from(start, vec![Joints::zeros(); path.len() - 1]);
        let [squares, best] = [least_squares, optimum].map(|find| find(&arm, &bounds, &path, start));
        assert_feasible(&best, start, &bounds);
        assert_feasible(&squares, start, &bounds);
        let [still, squares, best] = [&still, &squares, &best].map(|motion| error(&arm, motion, &path));
        assert!(best <= squares && squares < 0.7 * still, "{speed} rad/s: {best}, {squares}, still {still}");
        // Twice the acceleration and speed cannot make the result worse.
        let wide = Bounds { v_max: bounds.v_max.map(|v| 2.0 * v), a_max: bounds.a_max.map(|a| 2.0 * a), ..bounds };
        let freer = error(&arm, &optimum(&arm, &wide, &path, start), &path);
        assert!(freer < best, "{speed} rad/s: {freer} with more room, {best}");
    }
}

#[test]
fn following_command_writes_every_figure_of_a_motion() {
    let folder = tempfile::tempdir().expect("a folder");
    let mut motion = motion::builtin();
    motion.name = "short".to_owned();
    motion.frames = motion.frames.into_iter().skip(500).take(120).collect();
    motion::save_bvh(&motion, &folder.path().join("short.bvh")).expect("a motion file");
    let path = |name: &str| folder.path().join(name).display().to_string();
    let (json, plots, config) =
        (path("out.json"), path("plots"), root().join("config/teleop.toml").display().to_string());
    let from = path("");
    let words = ["eval", "--following", &from, "--config", &config, "--calibration", "rig", "--delay-ms", "100"];
    run(&Cli::parse_from(words.into_iter().chain(["--json", &json, "--plots", &plots]))).expect("the command succeeds");
    let out: Value = serde_json::from_str(&std::fs::read_to_string(&json).expect("the file")).expect("JSON");
    let clip = &out["clips"][0];
    let number = |key: &str| clip[key].as_f64().unwrap_or_else(|| panic!("{key}: {clip:#}"));
    assert_eq!((&clip["clip"], &clip["stopped"]), (&Value::from("short"), &Value::Null));
    assert!((1.9..2.2).contains(&number("seconds")), "{clip:#}");
    assert_eq!(clip["at_ms_deg"].as_object().map(serde_json::Map::len), Some(3), "60, 100 and 200 ms");
    assert_eq!(clip["at_ms_deg"]["100"], clip["at_delay_deg"]);
    assert!(number("best_deg") <= number("now_deg") && number("now_deg") < 90.0, "{clip:#}");
    assert!(number("optimum_deg") <= number("optimum_least_squares_deg") + 1e-9, "{clip:#}");
    // At its best delay the robot may be nearer, because the optimum has no delay.
    assert!(number("optimum_deg") < number("now_deg"), "{clip:#}");
    assert!((number("ratio") - number("at_delay_deg") / number("optimum_deg")).abs() < 1e-9);
    assert!((0.01..1.0).contains(&number("torque_share_max")) && (0.0..=1.0).contains(&number("on_plan_share")));
    let violations = clip["violations"].as_object().expect("kinds");
    assert!(violations.len() >= 12 && violations.values().all(|count| *count == 0), "{violations:?}");
    assert_eq!(out["mean"]["now_deg"], clip["now_deg"]);
    let picture = std::fs::read_to_string(folder.path().join("plots/short.svg")).expect("a picture");
    assert!(picture.contains("optimum") && picture.contains("</svg>"));
}
