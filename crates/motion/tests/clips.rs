//! Tests with the CMU clips beside the repository. Every test needs them.

use messages::{CalibrationSource, HingeCalibration, Layout};
use motion::{CalibrationMode, Motion, calibrate, limbs, load, raw_frame};
use std::path::{Path, PathBuf};

fn clips() -> Vec<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/motions/cmu");
    let entries = std::fs::read_dir(&folder).expect("the clips");
    let mut paths: Vec<PathBuf> = entries.flatten().map(|entry| entry.path()).collect();
    paths.retain(|path| path.extension().is_some_and(|e| e == "bvh"));
    paths.sort();
    paths
}

fn read(path: &Path) -> Motion {
    load(path).unwrap_or_else(|error| panic!("{error}"))
}

#[test]
#[ignore = "needs the clips of CMU in ../shared/motions/cmu"]
fn clips_load_without_warning_and_stand_on_floor() {
    let paths = clips();
    assert_eq!(paths.len(), 61);
    for path in paths {
        let motion = read(&path);
        assert_eq!((motion.guesses.unit, motion.guesses.up), ("cm", "+Y"), "{}", motion.name);
        assert!(motion.guesses.warnings.is_empty(), "{}: {:?}", motion.name, motion.guesses.warnings);
        assert!((motion.frame_rate_hz - 60.0).abs() < 0.01);
        let lowest = motion.frames.iter().flat_map(|f| f.positions.iter().map(|p| p[2])).fold(f32::MAX, f32::min);
        assert!((0.0..0.25).contains(&lowest), "{}: lowest joint at {lowest} m", motion.name);
    }
}

#[test]
#[ignore = "needs the clips of CMU in ../shared/motions/cmu"]
fn skeleton_stage_accepts_clips_except_one_known_jump() {
    let paths = clips();
    for path in paths {
        let motion = read(&path);
        let calibration = calibrate(&motion, CalibrationMode::First10s);
        let mut state = skeleton::State::new();
        for i in 0..motion.frames.len() {
            let mut raw = raw_frame(&motion, i, &calibration);
            raw.header.sequence = i as u64 + 1;
            raw.header.origin = messages::Stamp((i as u64 + 1) * 16_666_667);
            let now = raw.header.origin;
            skeleton::tick(&skeleton::Config::default(), &mut state, now, skeleton::Input { raw: &raw, stored: None });
        }
        // 003_02 has a wrist that jumps by 0.7 m for one frame. The jump and four frames of settling are dropped.
        let dropped = if motion.name == "003_02" { 5 } else { 0 };
        assert_eq!(state.accepted() as usize, motion.frames.len() - dropped, "{}", motion.name);
    }
}

#[test]
#[ignore = "needs the clips of CMU in ../shared/motions/cmu"]
fn hinges_of_first_10_s_match_hinges_of_clip() {
    let paths = clips();
    for path in paths {
        let motion = read(&path);
        let clip = calibrate(&motion, CalibrationMode::Clip);
        let causal = calibrate(&motion, CalibrationMode::First10s);
        assert_eq!((clip.flags, causal.flags), (15, 15), "{}", motion.name);
        for upper in [0, 2] {
            let dot: f32 = (0..3).map(|c| clip.hinge[upper][c] * causal.hinge[upper][c]).sum();
            assert!(dot > 0.999, "{}: limb {upper}: {dot}", motion.name);
        }
    }
}

#[test]
#[ignore = "needs the clips of CMU in ../shared/motions/cmu"]
fn elbow_with_calibration_only_flexes() {
    // With the right hinge and sign, the forearm relative to the upper arm is a flexion about -z of the upper
    // arm's frame. A twist about the bone follows. The forearm's bone lies in the upper arm's x-y plane, on the
    // positive side of x.
    let paths = clips();
    let (mut out_of_plane, mut count) = (0.0f64, 0.0f64);
    for path in paths.iter().skip(2).step_by(5) {
        let motion = read(path);
        for limbs in limbs(&motion, &calibrate(&motion, CalibrationMode::First10s)) {
            for (upper, fore, sign) in [(0, 1, 1.0), (2, 3, -1.0)] {
                let rotation = |q: [f32; 4]| {
                    let [x, y, z, w] = q.map(f64::from);
                    nalgebra::UnitQuaternion::new_normalize(nalgebra::Quaternion::new(w, x, y, z))
                };
                let bone = rotation(limbs[upper]).inverse() * (rotation(limbs[fore]) * nalgebra::Vector3::y() * sign);
                out_of_plane += bone.z.asin().abs().to_degrees();
                count += 1.0;
                assert!(bone.x > -0.1, "{}: an elbow bends backwards ({})", motion.name, bone.x);
            }
        }
    }
    let mean = out_of_plane / count;
    assert!(mean < 0.5, "forearms leave the plane of the hinge by {mean:.2} degrees on average");
}

#[test]
#[ignore = "needs the clips of CMU in ../shared/motions/cmu"]
fn hinges_without_calibration_are_learnt_within_10_s() {
    let paths = clips();
    let (mut learnt_s, mut off_deg) = (Vec::new(), Vec::new());
    for path in paths {
        let motion = read(&path);
        let clip = calibrate(&motion, CalibrationMode::Clip);
        let (mut state, mut learnt) = (skeleton::State::new(), None);
        let ten_s = (10.0 * motion.frame_rate_hz) as usize;
        for i in 0..motion.frames.len().min(ten_s) {
            let mut raw = raw_frame(&motion, i, &HingeCalibration::ZERO);
            raw.header.sequence = i as u64 + 1;
            raw.header.origin = messages::Stamp((i as u64 + 1) * 16_666_667);
            let (now, input) = (raw.header.origin, skeleton::Input { raw: &raw, stored: None });
            skeleton::tick(&skeleton::Config::default(), &mut state, now, input);
            if learnt.is_none() && state.calibration() == CalibrationSource::Online {
                learnt = Some(i as f64 / motion.frame_rate_hz);
            }
        }
        let Some(at_s) = learnt else {
            assert!(motion.frames.len() < ten_s, "{}: nothing learnt in 10 s", motion.name);
            continue;
        };
        learnt_s.push(at_s);
        let online = state.online();
        for limb in 0..4 {
            let dot: f32 = (0..3).map(|c| clip.hinge[limb][c] * online.hinge[limb][c]).sum();
            // The forearm's neutral position is the middle of the pronations seen so far.
            let allowed_deg = if limb % 2 == 0 { 2.6 } else { 45.0 };
            let off = f64::from(dot.min(1.0)).acos().to_degrees();
            assert!(off < allowed_deg, "{}: limb {limb} is {off:.1} deg off", motion.name);
            off_deg.push(off);
        }
    }
    let middle = |all: &mut Vec<f64>| {
        all.sort_by(f64::total_cmp);
        (all[all.len() / 2], all[all.len() - 1])
    };
    println!("{} clips: learnt after (median, most) {:?} s; ", learnt_s.len(), middle(&mut learnt_s));
    println!("off the whole clip's by (median, most) {:?} deg", middle(&mut off_deg));
}
