//! The named motions match their names and the files on disk, and can be read back.

use crate::batch::root;
use messages::{HingeCalibration, Smpl};
use motion::{CalibrationMode, Frame, Motion, SMPL_ARMS, calibrate, limbs};
use nalgebra::Vector3;
use poses::motions::{named_pose, names, paper_motions};
use poses::person::{hands, head};
use poses::trajectory::{ground_truth, read_csv};
use replay::keyposes::write::{compact_bvh, trajectory_csv};
use retarget::{Limbs, limb_error_deg};

fn model() -> robot::Model {
    config::load_model(&root().join("config/robots/tiago_dual.toml")).expect("the shipped robot").0
}

fn rig(motion: &Motion) -> HingeCalibration {
    calibrate(motion, CalibrationMode::Rig)
}

fn at(frame: &Frame, joint: Smpl) -> Vector3<f64> {
    Vector3::from(frame.positions[joint as usize]).cast()
}

/// Compares texts, except for the last digit of a number. Sines differ by a bit between machines.
fn same_text(a: &str, b: &str, grain: f64) -> Result<(), String> {
    let split = |text: &str| text.split([',', ' ', '\n']).map(str::to_owned).collect::<Vec<_>>();
    let (a, b) = (split(a), split(b));
    if a.len() != b.len() {
        return Err(format!("{} words, {} on disk", a.len(), b.len()));
    }
    for (a, b) in a.iter().zip(&b) {
        let near = a.parse::<f64>().ok().zip(b.parse::<f64>().ok()).is_some_and(|(a, b)| (a - b).abs() < 1.5 * grain);
        if a != b && !near {
            return Err(format!("{a}, on disk {b}"));
        }
    }
    Ok(())
}

#[test]
fn motion_files_on_disk_match_the_output_of_the_command() {
    let (model, folder) = (model(), root().join("tools/replay/motions"));
    for motion in paper_motions() {
        let texts =
            [("bvh", compact_bvh(&motion), 1e-3), ("csv", trajectory_csv(&ground_truth(&model, &motion)), 1e-4)];
        for (extension, text, grain) in texts {
            let file = folder.join(format!("{}.{extension}", motion.name));
            let disk = std::fs::read_to_string(&file).unwrap_or_else(|error| panic!("{}: {error}", file.display()));
            same_text(&text, &disk, grain)
                .unwrap_or_else(|why| panic!("{}: {why}; run `keyposes motions`", file.display()));
        }
    }
    let files = std::fs::read_dir(folder).expect("the folder").map(|entry| entry.expect("an entry").path());
    let written =
        files.filter(|file| file.extension().is_some_and(|extension| extension == "bvh" || extension == "csv"));
    assert_eq!(written.count(), 2 * names().len(), "a file that no motion writes");
}

#[test]
fn eleven_motions_last_3_to_6_s_and_return_to_hanging_arms() {
    let motions = paper_motions();
    assert_eq!(motions.len(), 11);
    for motion in &motions {
        assert!((3.0..=6.0).contains(&motion.duration_s()), "{}: {} s", motion.name, motion.duration_s());
        assert_eq!(motion.frame_rate_hz, 60.0);
        let all = limbs(motion, &rig(motion));
        let (first, last) = (all.first().expect("frames"), all.last().expect("frames"));
        let (first, last) =
            (Limbs::from_message(first).expect("rotations"), Limbs::from_message(last).expect("rotations"));
        for side in 0..2 {
            assert!(limb_error_deg(&first[side], &last[side]).iter().all(|degrees| *degrees < 0.1), "{}", motion.name);
        }
        for frame in [motion.frames.first(), motion.frames.last()].into_iter().flatten() {
            for (shoulder, wrist) in [(Smpl::LeftShoulder, Smpl::LeftWrist), (Smpl::RightShoulder, Smpl::RightWrist)] {
                assert!(at(frame, shoulder).z - at(frame, wrist).z > 0.5, "{}: the arms hang", motion.name);
            }
        }
    }
}

#[test]
fn named_poses_match_their_names() {
    let pose = |name: &str| named_pose(name).unwrap_or_else(|| panic!("no pose {name}"));
    let both = |name: &str| hands(&pose(name));

    let t = pose("t-pose");
    for [shoulder, elbow, wrist] in SMPL_ARMS {
        let straight = (at(&t, elbow) - at(&t, shoulder)).angle(&(at(&t, wrist) - at(&t, elbow)));
        assert!(straight < 1e-3, "the arm is bent by {straight} rad");
        assert!((at(&t, wrist).z - at(&t, shoulder).z).abs() < 1e-3);
    }
    let crown = head(&t).z + 0.11;
    assert!(both("hands-up").iter().all(|hand| hand.z > crown + 0.15), "hands up are above the head");
    for hand in both("hands-on-head") {
        let distance = (hand - head(&t)).norm();
        assert!((0.10..=0.14).contains(&distance), "{distance} m from the middle of a head of 0.11 m radius");
    }
    let breast = (at(&t, Smpl::LeftShoulder) + at(&t, Smpl::RightShoulder)) / 2.0 + Vector3::new(0.1, 0.0, -0.16);
    for hand in both("hands-to-chest") {
        assert!((hand - breast).norm() < 0.1, "{} m from the breast bone", (hand - breast).norm());
    }
    let [left, right] = both("clap");
    assert!((left - right).norm() < 0.05, "clapping hands are {} m apart", (left - right).norm());
    let [left, right] = both("cross-arms");
    assert!(left.y < -0.1 && right.y > 0.1, "crossed: the left hand is on the right side");
    let [left, right] = both("point-forward");
    assert!(right.x > 0.55 && left.x < 0.2, "the right arm points, the left one hangs");
    let [left, right] = both("wave-left");
    assert!(left.z > 1.45 && right.z < 1.0);
    let [left, right] = both("wave-right");
    assert!(right.z > 1.45 && left.z < 1.0);
    let [left, right] = both("box");
    assert!(left.x > 0.5 && right.x < 0.3, "one hand punches, the other guards");
    let [left, right] = both("stretch-sideways");
    assert!(left.z > crown && left.y < 0.0 && right.z < 1.1, "one arm over the head, one hand on the hip");
    assert!(named_pose("handstand").is_none());
}

#[test]
fn no_elbow_bends_backwards_and_no_hand_enters_the_trunk() {
    for motion in paper_motions() {
        for (i, frame) in motion.frames.iter().enumerate() {
            let shoulders = (at(frame, Smpl::LeftShoulder) + at(frame, Smpl::RightShoulder)) / 2.0;
            for hand in hands(frame) {
                let p = hand - shoulders;
                let inside = p.x.abs() < 0.08 && p.y.abs() < 0.14 && (-0.5..0.0).contains(&p.z);
                assert!(!inside, "{} frame {i}: a hand is in the trunk at {p:?}", motion.name);
            }
        }
        // The hinge of the rig is the axis of flexion. A bend against it would be an inverted elbow.
        for (i, frame) in motion.frames.iter().enumerate() {
            for (side, [shoulder, elbow, wrist]) in SMPL_ARMS.into_iter().enumerate() {
                let normal = (at(frame, elbow) - at(frame, shoulder)).cross(&(at(frame, wrist) - at(frame, elbow)));
                let [x, y, z, w] = frame.rotations[shoulder as usize].map(f64::from);
                let rotation = nalgebra::UnitQuaternion::new_normalize(nalgebra::Quaternion::new(w, x, y, z));
                let hinge = rotation * Vector3::z() * if side == 0 { -1.0 } else { 1.0 };
                assert!(normal.dot(&hinge) > -1e-6, "{} frame {i}: an elbow bends backwards", motion.name);
            }
        }
    }
}

#[test]
fn ground_truth_is_continuous_and_is_read_back_from_csv() {
    let model = model();
    let folder = tempfile::tempdir().expect("a folder");
    for motion in paper_motions() {
        let truth = ground_truth(&model, &motion);
        assert_eq!(truth.q.len(), motion.frames.len());
        for pair in truth.q.windows(2) {
            let step = (0..2).flat_map(|a| (0..5).map(move |j| (a, j)));
            let step = step.map(|(a, j)| (pair[1][a][j] - pair[0][a][j]).abs()).fold(0.0, f64::max);
            // 7 rad/s: the punch's elbow.
            assert!(step * 60.0 < 7.0, "{}: a joint at {:.1} rad/s", motion.name, step * 60.0);
        }
        let file = folder.path().join("trajectory.csv");
        std::fs::write(&file, trajectory_csv(&truth)).expect("written");
        let read = read_csv(&file, &model).expect("is read");
        assert_eq!((read.q.len(), &read.joint_names), (truth.q.len(), &truth.joint_names));
        assert!((read.rate_hz - 60.0).abs() < 0.05, "{} Hz", read.rate_hz);
        let off = read.q.iter().flatten().flatten().zip(truth.q.iter().flatten().flatten());
        assert!(off.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max) <= 0.5e-4 + 1e-12);
    }
}
