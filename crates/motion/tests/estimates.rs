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
        let asked = read.guesses.warnings.iter().any(|warning| warning.contains("the fastest wrist moves at"));
        assert_eq!(asked, asks, "{hz} Hz: {:?}", read.guesses.warnings);
    }
    // A minute of frames at 0.02 Hz lasts a week.
    let error = load_with(&path, &rate(0.02)).expect_err("too long").to_string();
    assert!(error.contains("at 0.02 Hz become") && error.contains("at most 120000; give the true rate"), "{error}");
}
