//! Every reason to drop a frame.

use crate::person::{feed, person, raw, running, seen, standing, t_pose_hinges};
use messages::{RawSkeleton, Stamp, raw_flag, skeleton_flag};
use skeleton::{Config, DropReason, Input, State, tick};

#[test]
fn valid_frame_is_accepted_and_keeps_its_header() {
    let mut state = State::default();
    let mut frame = raw(&standing(0.0), 0);
    frame.calibration = t_pose_hinges();
    let now = Stamp(1_005_000_000);
    let skeleton = seen(&mut state, now, &frame).expect("accepted");
    assert_eq!(skeleton.flags, skeleton_flag::ALL | skeleton_flag::CALIBRATED);
    assert_eq!((skeleton.header.origin, skeleton.received), (frame.header.origin, now));
    assert_eq!((skeleton.session_nonce, skeleton.operator_id), (7, 1));
    assert_eq!(skeleton.positions, standing(0.0).0);
    assert_eq!(state.accepted(), 1);
}

#[test]
fn each_kind_of_damage_is_dropped_with_its_reason() {
    type Damage = fn(&mut RawSkeleton);
    let cases: [(DropReason, Damage); 20] = [
        (DropReason::Layout, |f| f.layout = 2),
        (DropReason::Count, |f| f.joint_count = 24),
        (DropReason::Count, |f| f.flags |= 64),
        (DropReason::Count, |f| f.calibration.flags = 16),
        (DropReason::Mirrored, |f| f.flags |= raw_flag::MIRRORED),
        (DropReason::NoOrigin, |f| f.header.origin = Stamp::NONE),
        (DropReason::SessionChanged, |f| f.session_nonce = 8),
        (DropReason::OperatorChanged, |f| f.operator_id = 2),
        (DropReason::Duplicate, |f| f.header.sequence -= 1),
        (DropReason::Backwards, |f| f.header.sequence -= 2),
        (DropReason::Backwards, |f| f.header.origin.0 -= 40_000_000),
        (DropReason::NotFinite, |f| f.positions[21][2] = f32::NAN),
        (DropReason::NotFinite, |f| f.rotations[5][3] = f32::INFINITY),
        (DropReason::NotUnit, |f| f.rotations[16] = [0.0; 4]),
        (DropReason::OutOfRange, |f| f.confidence[3] = 1.5),
        (DropReason::OutOfRange, |f| f.positions[20] = [0.0, 1.6, 0.92]),
        (DropReason::OutOfRange, |f| f.positions.iter_mut().flatten().for_each(|c| *c *= 1000.0)),
        (DropReason::TrunkLost, |f| f.confidence[2] = 0.4),
        (DropReason::Size, |f| f.positions.iter_mut().flatten().for_each(|c| *c *= 0.5)),
        (DropReason::Chirality, |f| {
            for p in &mut f.positions {
                p[1] = -p[1];
            }
        }),
    ];
    for (i, (reason, damage)) in cases.into_iter().enumerate() {
        // A mirror image is refused from the start. In a running session the evidence must change first.
        let mut state = if reason == DropReason::Chirality { State::default() } else { running(30) };
        let mut frame = raw(&standing(0.5), 30);
        damage(&mut frame);
        assert_eq!(feed(&mut state, &frame), Some(reason), "case {i}");
        assert_eq!(state.dropped(reason), 1);
        assert_eq!(DropReason::ALL.iter().map(|&r| state.dropped(r)).sum::<u64>(), 1);
    }
}

#[test]
fn stamps_are_checked_on_receiver_clock() {
    let mut state = State::default();
    let frame = raw(&standing(0.0), 0);
    let config = Config::default();
    let mut at = |ns: i64| {
        let now = Stamp(frame.header.origin.0.saturating_add_signed(ns));
        tick(&config, &mut state, now, Input { raw: &frame, stored: None }).drop
    };
    assert_eq!(at(-2_000_001), Some(DropReason::Future));
    assert_eq!(at(100_000_001), Some(DropReason::Old));
    assert_eq!(at(-2_000_000), None);
    assert_eq!(at(0), Some(DropReason::Duplicate));
}

#[test]
fn session_must_begin_upright_and_may_bend_later() {
    let mut state = State::default();
    let mut frame = raw(&standing(0.0), 0);
    for p in &mut frame.positions {
        *p = [p[0], -p[2], p[1]]; // y up, sent as z up
    }
    assert_eq!(feed(&mut state, &frame), Some(DropReason::NotUpright));
    // Once upright, a person may bend down.
    let mut state = running(10);
    for i in 0..60 {
        let mut frame = raw(&standing(0.0), 10 + i);
        let (sin, cos) = (f64::from(i as u32) * 0.025).sin_cos();
        for p in &mut frame.positions {
            let (x, z) = (f64::from(p[0]), f64::from(p[2]));
            *p = [(x * cos + z * sin) as f32, p[1], (z * cos - x * sin) as f32];
        }
        assert_eq!(feed(&mut state, &frame), None, "frame {i}");
    }
}

/// A hand raised from the hip to above the head and lowered again within `s` seconds, at `rate_hz` frames a second.
fn raise(s: f64, rate_hz: f64) -> impl Iterator<Item = RawSkeleton> {
    (0..(3.0 * rate_hz) as u64).map(move |i| {
        let t = i as f64 / rate_hz;
        // Half a period up, at rest for a second, and down again.
        let phase = ((t - 0.5) / s).clamp(0.0, 1.0) - ((t - 1.5 - s) / s).clamp(0.0, 1.0);
        let up = -1.3 + 2.6 * (0.5 - 0.5 * (std::f64::consts::PI * phase).cos());
        let mut frame = raw(&person([0.2, up, 0.2, 0.3, 0.0], [0.3 + 0.1 * t, -1.2, 0.2, 0.6, 0.1]), i);
        frame.header.origin = Stamp(1_000_000_000 + (t * 1e9) as u64);
        frame
    })
}

#[test]
fn quickly_raised_hand_is_accepted_at_every_rate() {
    for rate_hz in [20.0, 30.0, 60.0, 120.0] {
        let fastest = |s: f64| {
            let wrists: Vec<_> = raise(s, rate_hz).map(|frame| nalgebra::Vector3::from(frame.positions[20])).collect();
            wrists.windows(2).map(|pair| f64::from((pair[1] - pair[0]).norm()) * rate_hz).fold(0.0, f64::max)
        };
        // A quarter of a second is a quick wave. A tenth is faster than any person.
        for (s, refused) in [(0.25, false), (0.08, true)] {
            let mut state = State::default();
            let counted = raise(s, rate_hz).filter(|frame| feed(&mut state, frame).is_some()).count();
            assert_eq!(counted > 0, refused, "{rate_hz} Hz, {s} s, up to {} m/s: {counted} frames", fastest(s));
        }
        assert!((7.0..9.5).contains(&fastest(0.25)), "{} m/s", fastest(0.25));
    }
}

#[test]
fn f007_jumping_arm_is_not_used_and_other_arm_is() {
    let mut state = running(20);
    let known = |frame: &RawSkeleton, state: &mut State| seen(state, frame.header.origin, frame).expect("a person");
    let operator = known(&raw(&standing(20.0 / 60.0), 20), &mut state).operator_id;
    for i in 21..40 {
        let mut frame = raw(&standing(i as f64 / 60.0), i);
        let wild = i == 25 || i == 26;
        if wild {
            // Same length, other place: the forearm's other end.
            let jumped = person([0.3, -0.9, 0.2, 0.6, 0.0], [0.3, 0.9, 0.2, 0.6, 0.1]);
            (18..22).step_by(2).for_each(|joint| frame.positions[joint] = jumped.0[joint]);
        }
        let person = known(&frame, &mut state);
        let arms = [skeleton_flag::LIMB[0] | skeleton_flag::LIMB[1], skeleton_flag::LIMB[2] | skeleton_flag::LIMB[3]];
        assert_eq!(person.flags & arms[0] == arms[0], !wild, "frame {i}");
        assert_eq!(person.flags & arms[1], arms[1], "frame {i}");
        assert_eq!(person.operator_id, operator, "frame {i}: two wild frames make nobody a stranger");
    }
    assert_eq!(state.dropped(DropReason::Teleport), 2);
}

#[test]
fn f013_dropped_frame_does_not_reset_frozen_timer() {
    let mut state = running(60);
    let mut accepted_last = 0;
    for i in 0..60 {
        let mut frame = raw(&standing(59.0 / 60.0), 60 + i);
        // In some frames the arm is too long, each time by another length, and then right again: both are refused.
        if i % 5 == 3 {
            frame.positions[20][1] += 0.05 + 0.001 * i as f32;
        }
        match feed(&mut state, &frame) {
            None => accepted_last = i,
            Some(DropReason::LengthStep) => assert!(i % 5 >= 3, "frame {i}"),
            Some(reason) => assert_eq!(reason, DropReason::Frozen, "frame {i}"),
        }
    }
    assert!(accepted_last <= 8, "{accepted_last}: 100 ms after the tracker got stuck nothing of it is used");
}

#[test]
fn person_after_long_drop_gets_new_id_for_any_operator_id() {
    let config = Config::default();
    for operator_id in [0, 1, u32::MAX] {
        for (silent_ns, same) in [(config.distrust_after_ns, true), (config.distrust_after_ns + 1, false)] {
            let mut state = State::default();
            let mut see = |ns: u64, i: u64, damage: bool| {
                let mut frame = raw(&standing(0.0), i);
                (frame.operator_id, frame.header.origin) = (operator_id, Stamp(1_000_000_000 + ns));
                if damage {
                    frame.positions[20][2] = f32::NAN;
                }
                let input = Input { raw: &frame, stored: None };
                tick(&config, &mut state, Stamp(1_000_000_000 + ns), input).skeleton.map(|person| person.operator_id)
            };
            let first = see(0, 1, false);
            assert!(first.is_some() && see(1, 2, true).is_none());
            assert_eq!(see(silent_ns, 3, false) == first, same, "operator {operator_id}, {silent_ns} ns");
            assert_eq!(state.accepted(), 2);
        }
    }
}

#[test]
fn f011_f015_unseen_arm_with_nan_is_flagged_invalid() {
    let mut state = running(10);
    let mut frame = raw(&standing(10.0 / 60.0), 10);
    frame.confidence[20] = 0.1;
    frame.positions[20] = [f32::NAN; 3];
    frame.rotations[20] = [f32::NAN; 4];
    let out = seen(&mut state, frame.header.origin, &frame).expect("accepted");
    assert_eq!(out.flags & skeleton_flag::ALL, skeleton_flag::ALL & !skeleton_flag::LIMB[1]);
    assert!(out.positions.iter().flatten().all(|c| c.is_finite()));
}
