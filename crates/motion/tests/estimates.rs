//! Tests positions that a network estimated: limbs that stretch, and rates that nobody wrote down.

use crate::arrays::{folder, largest_angle, short};
use crate::writers::*;
use motion::{LoadOptions, load, load_with};

#[test]
fn limbs_that_change_their_lengths_get_their_median() {
    let folder = folder();
    let motion = positions_only(short());
    let path = folder.path().join("network.npy");
    for change in [0.04, 0.12] {
        let mut changed = motion.clone();
        for (n, frame) in changed.frames.iter_mut().enumerate() {
            let factor = 1.0 + change * (0.3 * n as f32).sin();
            let [elbow, wrist] = [18, 20].map(|joint| frame.positions[joint]);
            frame.positions[20] = std::array::from_fn(|c| elbow[c] + factor * (wrist[c] - elbow[c]));
        }
        write_npy(&path, &[motion.frames.len(), 22, 3], &positions_y_up(&changed), Kind::F64);
        let read = load(&path).expect("a motion");
        let warning = format!("limbs change their lengths (left_wrist by up to {:.0} %)", 100.0 * change);
        assert!(read.guesses.warnings.iter().any(|own| own.starts_with(&warning)), "{:?}", read.guesses.warnings);
        assert!(largest_angle(&motion, &read) < 0.05);
        let length = |frame: &motion::Frame| {
            let [elbow, wrist] = [18, 20].map(|joint| nalgebra::Vector3::from(frame.positions[joint]));
            (wrist - elbow).norm()
        };
        for (frame, source) in read.frames.iter().zip(&motion.frames) {
            assert!((length(frame) / length(source) - 1.0).abs() < 0.01, "{change}");
        }
    }
}

#[test]
fn rate_that_moves_nobody_so_is_asked_for_and_endless_motion_is_refused() {
    let folder = folder();
    let motion = short();
    let path = folder.path().join("clip.npy");
    write_npy(&path, &[motion.frames.len(), 22, 3], &positions_y_up(&motion), Kind::F32);
    let rate = |hz| LoadOptions { frame_rate_hz: Some(hz), ..LoadOptions::default() };
    for (hz, asks) in [(20.0, false), (400.0, true), (1.0, true)] {
        let read = load_with(&path, &rate(hz)).expect("a motion");
        assert_eq!(read.frame_rate_hz, hz);
        let asked = read.guesses.warnings.iter().any(|warning| warning.contains("the fastest wrist moves at"));
        assert_eq!(asked, asks, "{hz} Hz: {:?}", read.guesses.warnings);
    }
    for bad in [0.0, -1.0, f64::NAN, 1e9] {
        let error = load_with(&path, &rate(bad)).expect_err("no rate").to_string();
        assert!(error.contains("is not within [0.01, 100000]"), "{error}");
    }
    // A minute of frames at 0.02 Hz lasts a week.
    let error = load_with(&path, &rate(0.02)).expect_err("too long").to_string();
    assert!(error.contains("at 0.02 Hz become") && error.contains("at most 120000; give the true rate"), "{error}");
}

#[test]
fn joint_that_is_not_seen_is_named_and_its_limbs_are_held() {
    let folder = folder();
    let mut motion = positions_only(short());
    let whole = motion::limbs(&motion, &motion::calibrate(&motion, motion::CalibrationMode::None));
    for frame in &mut motion.frames[4..6] {
        (frame.positions[13], frame.positions[20]) = ([0.0; 3], [0.0; 3]);
    }
    let path = folder.path().join("clip.npy");
    write_npy(&path, &[motion.frames.len(), 22, 3], &positions_y_up(&motion), Kind::F64);
    let read = load(&path).expect("a motion");
    let warning = "frame 4 and 1 more: left_wrist or another joint is not seen (0, 0, 0): its limbs are held";
    assert!(read.guesses.warnings.iter().any(|own| own == warning), "{:?}", read.guesses.warnings);
    assert!(!read.guesses.warnings.iter().any(|own| own.contains("lengths")), "{:?}", read.guesses.warnings);
    let limbs = motion::limbs(&read, &motion::calibrate(&read, motion::CalibrationMode::None));
    let forearm = messages::Limb::LeftFore as usize;
    assert_eq!([limbs[4][forearm], limbs[5][forearm]], [limbs[3][forearm]; 2]);
    assert!(limbs[6][forearm].iter().zip(whole[6][forearm]).all(|(is, was)| (is - was).abs() < 1e-3));
    for [a, b] in [[3, 4], [5, 6]] {
        let between = motion::mix(&read.frames[a], &read.frames[b], 0.5);
        assert_eq!([between.positions[13], between.positions[20]], [[0.0; 3]; 2], "an unseen joint is not half seen");
        let moved = [0, 1, 2].map(|axis| (between.positions[16][axis] - read.frames[a].positions[16][axis]).abs());
        assert!(moved.iter().all(|&m| m < 0.05), "the shoulder jumps behind an unseen collar: {moved:?}");
    }
    // A person who stands behind the origin, and whose feet nobody sees, is no mirror image.
    for frame in &mut motion.frames {
        frame.positions = frame.positions.map(|[x, y, z]| [x - 3.0, y, z]);
        for joint in [7, 8, 10, 11] {
            frame.positions[joint] = [0.0; 3];
        }
    }
    write_npy(&path, &[motion.frames.len(), 22, 3], &positions_y_up(&motion), Kind::F64);
    assert!(load(&path).is_ok(), "{:?}", load(&path).map(|motion| motion.name));
}

#[test]
fn number_that_no_person_has_is_named_with_its_frame_and_joint() {
    let folder = folder();
    let path = folder.path().join("clip.bvh");
    let motion = short();
    let text = motion::write_bvh(&motion);
    let frames = text.lines().count() - motion.frames.len();
    let with = |frame: usize, column: usize, value: &str| {
        let mut lines: Vec<String> = text.lines().map(str::to_owned).collect();
        let mut numbers: Vec<&str> = text.lines().nth(frames + frame).expect("a line").split(' ').collect();
        numbers[column] = value;
        lines[frames + frame] = numbers.join(" ");
        std::fs::write(&path, lines.join("\n")).expect("written");
        load(&path).expect("a motion").guesses.warnings.join("; ")
    };
    assert!(!with(5, 0, "0").contains("damaged"));
    // A pose stands before the frames. Each joint has three numbers for its place and three for its rotation.
    let (hip, leg) = ("frame 6: left_hip is 1000.0 m from the pelvis", "frame 6: LeftUpLeg turns from ");
    for (column, warning) in [(0, "frame 6: the pelvis moves by 1000.0 m"), (6, hip), (9, leg)] {
        let found = with(5, column, "99999");
        assert!(found.contains(warning) && found.contains(": is a number damaged?"), "{found}");
    }
}
