//! Tests with the CMU clips beside the repository. Every test needs them.

use motion::{CalibrationMode, Motion, calibrate, load, raw_frame};
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
