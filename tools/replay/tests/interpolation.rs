//! Interpolation: it goes through the poses, is monotone between them and playable, and errors name bad input.
#![expect(clippy::needless_range_loop, reason = "sides, joints and rows are clearer by their indices")]

use crate::batch::root;
use motion::{CalibrationMode, LoadOptions, calibrate, limbs};
use poses::pose::read_pose;
use poses::trajectory::{Trajectory, read_csv, to_motion};
use replay::keyposes::interpolate::{Options, Space, interpolate};
use replay::keyposes::write::{compact_bvh, trajectory_csv};
use retarget::{ArmModel, Limbs, Network, PRIOR_WEIGHT, features, limb_error_deg, refine};
use robot::Model;
use std::process::Command;

fn robot() -> (Model, Network) {
    let model = config::load_model(&root().join("config/robots/tiago_dual.toml")).expect("the shipped robot").0;
    let network =
        config::load_weights(&root().join("weights/tiago_dual"), &model).expect("the shipped weights").network;
    (model, network)
}

fn poses(names: &[&str]) -> Vec<[Limbs; 2]> {
    names
        .iter()
        .map(|name| read_pose(name, CalibrationMode::First10s, &LoadOptions::default()).expect("a pose"))
        .collect()
}

fn between(space: Space, names: &[&str]) -> Trajectory {
    let (model, network) = robot();
    let options = Options { seconds: 2.0, rate_hz: 60.0, space, refine_steps: 2 };
    interpolate(&model, &network, &poses(names), &options).expect("a trajectory")
}

const KEYS: [&str; 4] = ["t-pose", "clap", "box", "rest"];

#[test]
fn trajectory_stops_at_every_pose_as_retargeted() {
    let (model, network) = robot();
    let arm = ArmModel::from_model(&model, 0);
    for space in [Space::Latent, Space::Joint] {
        let found = between(space, &KEYS);
        assert_eq!(found.q.len(), 3 * 120 + 1);
        for (i, pose) in poses(&KEYS).iter().enumerate() {
            for side in 0..2 {
                let [start] = network.decode(&network.encode_human(&[features(&pose[side])]));
                let want = refine(&arm, &pose[side], &start, &start, PRIOR_WEIGHT, 2).q;
                for j in 0..5 {
                    assert!((found.q[120 * i][side][j] - want[j]).abs() < 1e-6, "{space:?} pose {i} joint {j}");
                    let slow = |k: usize| (found.q[k + 1][side][j] - found.q[k][side][j]).abs() * 60.0;
                    assert!(i == 3 || slow(120 * i) < 0.05, "{space:?}: it starts from rest");
                }
            }
        }
    }
}

#[test]
fn trajectory_is_monotone_in_joints_and_near_slerp_in_latent() {
    let joint = between(Space::Joint, &KEYS);
    let latent = between(Space::Latent, &KEYS);
    let arm = ArmModel::from_model(&robot().0, 0);
    let keys = poses(&KEYS);
    for piece in 0..3 {
        for side in 0..2 {
            for j in 0..5 {
                let q: Vec<f64> = (0..=120).map(|i| joint.q[120 * piece + i][side][j]).collect();
                let sign = (q[120] - q[0]).signum();
                assert!(q.windows(2).all(|w| (w[1] - w[0]) * sign >= 0.0), "joint {j} is monotone");
            }
            // Through the latent space the arm stays near the slerp of the human's.
            let (a, b) = (&keys[piece][side], &keys[piece + 1][side]);
            let error = (0..=120).flat_map(|i| {
                let human = a.slerp(b, poses::motions::minimum_jerk(f64::from(i) / 120.0));
                limb_error_deg(&arm.forward(&latent.q[120 * piece + i as usize][side]), &human)
            });
            let mean = error.sum::<f64>() / 242.0;
            assert!(mean < 8.0, "piece {piece} side {side}: {mean:.2} degrees from the slerp");
        }
    }
}

#[test]
fn motion_of_a_trajectory_has_the_limbs_of_the_robot() {
    let (model, _) = robot();
    let arm = ArmModel::from_model(&model, 0);
    let trajectory = between(Space::Latent, &["hands-to-chest", "point-forward"]);
    let motion = to_motion(&trajectory, &model, "test");
    let read = motion::parse_bvh("test", compact_bvh(&motion).as_bytes()).expect("is read");
    for motion in [motion, read] {
        let all = limbs(&motion, &calibrate(&motion, CalibrationMode::Rig));
        assert_eq!(all.len(), trajectory.q.len());
        for (limbs, q) in all.iter().zip(&trajectory.q) {
            let arms = Limbs::from_message(limbs).expect("rotations");
            for side in 0..2 {
                let error = limb_error_deg(&arm.forward(&q[side]), &arms[side]);
                assert!(error.iter().all(|degrees| *degrees < 0.1), "{error:?} degrees");
            }
        }
    }
}

#[test]
fn csv_is_resampled_to_60_hz_and_bad_csv_is_refused_by_line() {
    let (model, _) = robot();
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("t.csv");
    let trajectory = between(Space::Latent, &["t-pose", "rest"]);
    let fast = Trajectory { rate_hz: 600.0, ..trajectory.clone() };
    std::fs::write(&file, trajectory_csv(&fast)).expect("written");
    let read = read_csv(&file, &model).expect("is read");
    assert_eq!((read.rate_hz, read.q.len(), read.is_resampled), (60.0, 13, true), "0.2 s at 60 Hz");
    let warnings = to_motion(&read, &model, "fast").guesses.warnings;
    assert!(warnings[1].starts_with("its rows have no constant rate of 30 to 240 Hz"), "{warnings:?}");
    let text = trajectory_csv(&trajectory);
    let lines: Vec<&str> = text.lines().collect();
    let name = &trajectory.joint_names[0][3];
    for (bad, expected) in [
        (String::new(), "t.csv:1: is empty; `replay keyposes interpolate` writes"),
        (text.replace("time_s", "time"), "has no column time_s or t_s, but time, arm_left_1_joint, "),
        (text.replace(name.as_str(), "elbow"), "has no column arm_left_4_joint, but time_s, "),
        (lines[..2].join("\n"), "has 1 rows, at least 2 are needed"),
        ([lines[0], lines[1], lines[1]].join("\n"), "t.csv:3: time 0.0 s is not after 0.0 s; put"),
        // A row of an hour is no motion, and would take 1 GB.
        (
            [lines[0], lines[1], &lines[1].replacen('0', "3600", 1)].join("\n"),
            "lasts 3600.0 s, but 2 to 120000 frames at 60",
        ),
        ([lines[0], "0,1,2"].join("\n"), "t.csv:2: has 3 columns, the header 11"),
        ([lines[0], "0,0,0,0,0,0,0,0,0,0,NaN"].join("\n"), "column 11: \"NaN\" is not a number"),
        ([lines[0], "0,0,0,0,0,0,0,0,0,0,3"].join("\n"), "arm_right_5_joint = 3.0 rad is outside [-2.0"),
    ] {
        std::fs::write(&file, bad).expect("written");
        let error = read_csv(&file, &model).expect_err("is refused").to_string();
        assert!(error.contains(expected), "{error}");
    }
}

#[test]
fn interpolate_writes_both_files_and_refuses_to_replace_an_input() {
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("i.csv");
    let run = |arguments: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_replay"));
        command
            .current_dir(root())
            .args(["keyposes", "interpolate"])
            .args(arguments)
            .arg("--out")
            .arg(&out)
            .output()
            .expect("it runs")
    };
    let done = run(&["t-pose", "tools/replay/motions/clap.bvh:100", "tools/replay/motions/box.bvh@2.5"]);
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    assert_eq!(std::fs::read_to_string(&out).expect("the trajectory").lines().count(), 242);
    assert_eq!(motion::load(&out.with_extension("bvh")).expect("the motion").frames.len(), 241);
    // The same frame by its number, and by its time at another rate.
    let written = [
        &["t-pose", "tools/replay/motions/clap.bvh:180", "--calibration", "rig"][..],
        &["t-pose", "tools/replay/motions/clap.bvh@6", "--calibration", "rig", "--frame-rate", "30"],
    ]
    .map(|arguments| (run(arguments).status.success(), std::fs::read_to_string(&out).expect("the trajectory")));
    assert!(written[0].0 && written[0] == written[1], "--frame-rate changes the time of a frame");
    // The motion next to the trajectory is one of the input files. It must stay unchanged.
    let before = std::fs::read(out.with_extension("bvh")).expect("the motion");
    let own = format!("{}:3", out.with_extension("bvh").display());
    let refused = run(&["t-pose", &own]);
    assert!(String::from_utf8_lossy(&refused.stderr).contains("is one of the inputs"), "{refused:?}");
    assert_eq!(std::fs::read(out.with_extension("bvh")).expect("is still there"), before);
}

/// Poses anywhere in the arm's reach and slightly beyond, where refinement finds other branches than the network.
#[test]
fn trajectory_rows_between_random_poses_do_not_jump() {
    let (model, network) = robot();
    let arm = ArmModel::from_model(&model, 0);
    let mut state = 7_u64;
    let mut uniform = || {
        // Knuth's linear congruential generator (MMIX).
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1_u64 << 53) as f64
    };
    let mut pose = || {
        let mut side =
            || arm.forward(&std::array::from_fn(|j| arm.mid()[j] + 1.2 * arm.half()[j] * (2.0 * uniform() - 1.0)));
        [side(), side()]
    };
    let options = Options { seconds: 2.0, rate_hz: 60.0, space: Space::Latent, refine_steps: 2 };
    for _ in 0..60 {
        let poses = [pose(), pose()];
        let found = interpolate(&model, &network, &poses, &options).expect("poses are in range");
        for (i, pair) in found.q.windows(2).enumerate() {
            for (a, b) in pair[0].as_flattened().iter().zip(pair[1].as_flattened()) {
                // 1.875 / 2 s is the peak of minimum jerk: 0.07 rad per row over the longest joint range. The
                // network is steeper in places.
                assert!((a - b).abs() < 0.5, "row {i}: {a} to {b}");
            }
        }
    }
}
