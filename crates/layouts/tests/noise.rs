//! The filter for cameras: less noise, the documented delay, and no error hidden from the validation.

use crate::client::{CAMERA, PERIOD_NS, frame};
use crate::salt::{Chance, ON};
use layouts::NoiseState;
use messages::RawSkeleton;
use skeleton::{Config, DropReason, Input, State, tick};

#[test]
fn f017_filter_at_rest_reduces_noise() {
    let (mut state, mut tremble) = (NoiseState::default(), Chance(1));
    let (mut before, mut after) = (0.0, 0.0);
    for i in 0..600 {
        let mut raw = frame(i);
        let still = raw.positions[20][1];
        raw.positions.iter_mut().take(22).flatten().for_each(|x| *x += 0.02 * (tremble.uniform() - 0.5));
        before += (raw.positions[20][1] - still).powi(2);
        ON.filter(&mut state, CAMERA, &mut raw);
        after += (raw.positions[20][1] - still).powi(2);
    }
    assert!(after < 0.25 * before, "{after} of {before}");
}

#[test]
fn filter_delay_of_moving_joint_matches_formula() {
    for speed in [0.25_f32, 1.0, 3.0] {
        let mut state = NoiseState::default();
        let mut behind = 0.0;
        for i in 0..150 {
            let mut raw = frame(i);
            let to = 0.3 + speed * i as f32 * PERIOD_NS as f32 * 1e-9;
            raw.positions[20][0] = to;
            ON.filter(&mut state, CAMERA, &mut raw);
            behind = to - raw.positions[20][0];
        }
        // A low-pass of first order lags a ramp by 1 / (2 pi f_c).
        let late_s = 1.0 / (std::f32::consts::TAU * (1.5 + 10.0 * speed));
        assert!((behind / speed / late_s - 1.0).abs() < 0.02, "{speed} m/s: {behind} m, {late_s} s");
    }
}

#[test]
fn f013_frozen_tracker_is_dropped_at_same_frame_with_filter() {
    let (mut filtered, mut plain, mut noise) = (State::default(), State::default(), NoiseState::default());
    let mut drops = 0;
    for i in 0..40 {
        let mut raw = frame(i);
        for place in &mut raw.positions {
            place[0] += 0.002 * i.min(20) as f32;
        }
        let look = |state: &mut State, raw: &RawSkeleton| {
            tick(&Config::default(), state, raw.header.origin.plus_ns(1_000_000), Input { raw, stored: None }).drop
        };
        let without = look(&mut plain, &raw);
        ON.filter(&mut noise, CAMERA, &mut raw);
        assert_eq!(look(&mut filtered, &raw), without, "frame {i}");
        drops += usize::from(without == Some(DropReason::Frozen));
    }
    assert!(drops > 10, "{drops}");
}

#[test]
fn nan_or_unseen_joint_passes_filter_and_leaves_no_trace() {
    let (mut state, mut clean) = (NoiseState::default(), NoiseState::default());
    for i in 0..30 {
        let (mut raw, mut reference) = (frame(i), frame(i));
        for person in [&mut raw, &mut reference] {
            person.positions[21][2] += 0.001 * i as f32;
        }
        if i == 10 {
            raw.positions[20] = [f32::NAN, 1.0, f32::INFINITY];
        }
        if i == 15 {
            (raw.positions[18][0], raw.confidence[18]) = (1e30, 0.2);
        }
        let came = raw;
        ON.filter(&mut state, CAMERA, &mut raw);
        ON.filter(&mut clean, CAMERA, &mut reference);
        if i == 10 {
            assert!(raw.positions[20][0].is_nan() && raw.positions[20][2].is_infinite());
        } else if i == 15 {
            assert_eq!(raw.positions[18], came.positions[18]);
        } else {
            assert_eq!(raw.positions[..22], reference.positions[..22], "frame {i}");
        }
    }
}
