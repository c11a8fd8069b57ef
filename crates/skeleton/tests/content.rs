//! Contents of a frame: numbers that are not finite, impossible bodies, sides, units and axes.

use crate::person::{feed, person, raw, read, running, seen, standing, store, t_pose_hinges};
use messages::{RawSkeleton, SMPL_JOINTS, Skeleton, skeleton_flag};
use proptest::prelude::*;
use skeleton::{Config, DropReason, State};

/// Returns the person of a frame, if it was accepted with both arms.
fn accepted(state: &mut State, raw: &RawSkeleton) -> Option<Skeleton> {
    let now = raw.header.origin.plus_ns(1_000_000);
    seen(state, now, raw).filter(|person| person.flags & skeleton_flag::ALL == skeleton_flag::ALL)
}

/// Frame `i` at 60 Hz of the moving person, with hinges, so that rotations are used.
fn frame(i: u64) -> RawSkeleton {
    let mut frame = raw(&standing(i as f64 / 60.0), i);
    frame.calibration = t_pose_hinges();
    frame
}

/// All numbers of a frame that are used.
fn numbers(frame: &mut RawSkeleton) -> Vec<&mut f32> {
    let RawSkeleton { positions, rotations, confidence, calibration, .. } = frame;
    let mut all: Vec<&mut f32> = positions[..SMPL_JOINTS].iter_mut().flatten().collect();
    all.extend(rotations[..SMPL_JOINTS].iter_mut().flatten());
    all.extend(confidence[..SMPL_JOINTS].iter_mut());
    all.extend(calibration.hinge.iter_mut().flatten());
    all
}

/// Swaps left and right for pairs of joints (index of the left one).
fn swap(frame: &mut RawSkeleton, pairs: &[usize]) {
    for &left in pairs {
        frame.positions.swap(left, left + 1);
        frame.rotations.swap(left, left + 1);
    }
}

#[test]
fn f006_f007_f012_f013_person_after_long_drop_gets_new_id() {
    type Fault = fn(&mut RawSkeleton, u64);
    let faults: [(DropReason, Fault); 4] = [
        (DropReason::NotFinite, |f, _| f.positions[20][0] = f32::NAN),
        (DropReason::LengthChange, |f, _| f.positions[20][0] += 0.05),
        (DropReason::Teleport, |f, i| {
            if i % 2 == 1 {
                let other = person([0.3, -0.9, 0.2, 0.6, 0.0], [0.3, 0.9, 0.2, 0.6, 0.1]);
                f.positions[..SMPL_JOINTS].copy_from_slice(&other.0);
            }
        }),
        (DropReason::Frozen, |f, _| {
            let frozen = standing(59.0 / 60.0);
            f.positions[..SMPL_JOINTS].copy_from_slice(&frozen.0);
            f.rotations[..SMPL_JOINTS].copy_from_slice(&frozen.1);
        }),
    ];
    for (reason, fault) in faults {
        for (frames, stranger) in [(3, false), (30, true)] {
            let mut state = running(60);
            let known = accepted(&mut state, &raw(&standing(1.0), 60)).expect("accepted").operator_id;
            for i in 61..61 + frames {
                let mut bad = raw(&standing(i as f64 / 60.0), i);
                fault(&mut bad, i);
                feed(&mut state, &bad);
            }
            assert!(reason == DropReason::Frozen && !stranger || state.dropped(reason) > 0, "{reason:?}");
            let again = (61 + frames..200).find_map(|i| accepted(&mut state, &raw(&standing(i as f64 / 60.0), i)));
            let again = again.expect("is seen again").operator_id;
            assert_eq!(again != known, stranger, "{reason:?}, {frames} frames");
        }
    }
}

#[test]
fn person_keeps_id_after_gap_of_1_2_s_and_not_of_1_7_s() {
    for (frames, stranger) in [(30, false), (70, false), (100, true)] {
        let mut state = running(60);
        let known = accepted(&mut state, &raw(&standing(1.0), 60)).expect("accepted").operator_id;
        let i = 61 + frames;
        let again = accepted(&mut state, &raw(&standing(1.0 + 1.0 / 60.0), i)).expect("accepted").operator_id;
        assert_eq!(again != known, stranger, "{frames} frames are lost");
    }
    let mut state = running(60);
    let known = accepted(&mut state, &raw(&standing(1.0), 60)).expect("accepted").operator_id;
    for i in 61..100 {
        let mut hidden = raw(&standing(1.0), i);
        hidden.confidence[1] = 0.0;
        assert_eq!(feed(&mut state, &hidden), Some(DropReason::TrunkLost));
    }
    let again = accepted(&mut state, &raw(&standing(1.01), 100)).expect("accepted").operator_id;
    assert_eq!(again, known, "a tracker that says that it sees nobody says nothing wrong");
}

#[test]
fn f016_new_operator_gets_new_person_id_at_once() {
    let mut state = running(60);
    let mut seen = vec![accepted(&mut state, &raw(&standing(1.0), 60)).expect("accepted").operator_id];
    for (i, operator) in [(61, 2), (63, 1), (65, 2)] {
        let mut other = raw(&standing(i as f64 / 60.0), i);
        other.operator_id = operator;
        assert_eq!(feed(&mut state, &other), Some(DropReason::OperatorChanged));
        other = raw(&standing((i + 1) as f64 / 60.0), i + 1);
        other.operator_id = operator;
        let person = accepted(&mut state, &other).expect("accepted");
        assert!(!seen.contains(&person.operator_id), "operator {operator}");
        seen.push(person.operator_id);
    }
    // A silence, after which everything is forgotten, does not hide that it is another person.
    let mut late = raw(&standing(3.0), 300);
    late.operator_id = 1;
    assert_eq!(feed(&mut state, &late), Some(DropReason::OperatorChanged));
}

#[test]
fn f007_person_keeps_id_after_jump_at_any_rate() {
    for period_ns in [8_333_333, 33_333_333, 66_666_667] {
        let mut state = State::default();
        let mut at = |i: u64, jumped: bool| {
            let down = person([0.3, -0.9, 0.2, 0.6, 0.0], [0.3, 0.9, 0.2, 0.6, 0.1]);
            let up = person([0.3, 0.9, 0.2, 0.6, 0.0], [0.3, 0.9, 0.2, 0.6, 0.1]);
            let mut frame = raw(if jumped { &down } else { &up }, i);
            frame.positions[20][0] += 1e-4 * i as f32;
            frame.header.origin.0 = 1_000_000_000 + i * period_ns;
            accepted(&mut state, &frame).map(|person| person.operator_id)
        };
        let known = at(0, false).expect("accepted");
        assert_eq!(at(1, false), Some(known));
        let settled = 2 + Config::default().coherent_ns.div_ceil(period_ns);
        assert!((2..settled).all(|i| at(i, true).is_none()), "{period_ns} ns");
        assert_eq!(at(settled, true), Some(known), "{period_ns} ns");
    }
}

#[test]
fn f008_walking_operator_moves_no_limb_until_range_ends() {
    let mut state = State::default();
    let still = standing(0.3);
    let here = accepted(&mut State::default(), &raw(&still, 0)).expect("accepted").limbs;
    for i in 0..900 {
        let mut away = raw(&still, i);
        away.positions[..SMPL_JOINTS].iter_mut().for_each(|p| p[1] += 0.12 * i as f32);
        away.positions[15][0] += 1e-4 * (i % 7) as f32;
        let person = accepted(&mut state, &away);
        // The range ends at 100 m.
        let inside = away.positions.iter().all(|p| p[1] <= 100.0);
        assert_eq!(person.is_some(), inside, "{} m away", 0.12 * i as f64);
        for (limb, here) in person.iter().flat_map(|person| person.limbs.iter().zip(&here)) {
            assert!(read(*limb).angle_to(&read(*here)) < 1e-3, "{} m away", 0.12 * i as f64);
        }
    }
    assert!(state.dropped(DropReason::OutOfRange) > 0);
}

#[test]
fn f009_swapped_sides_are_dropped_from_first_frame() {
    let swaps: [&[usize]; 4] = [&[1, 4, 7, 10, 13, 16, 18, 20], &[13, 16, 18, 20], &[18, 20], &[20]];
    for pairs in swaps {
        for from in [0, 60] {
            for rate in [1, 2] {
                let mut state = running(from);
                for i in (from..from + 120).filter(|i| i % rate == 0) {
                    let mut swapped = raw(&standing(i as f64 / 60.0), i);
                    swap(&mut swapped, pairs);
                    assert!(feed(&mut state, &swapped).is_some(), "{pairs:?} from {from}: frame {i} came through");
                }
            }
        }
    }
    // They are also refused after a silence shorter than the gap, in which no frame showed the jump.
    for (pairs, from) in swaps.into_iter().flat_map(|pairs| [64, 68, 100].map(|from| (pairs, from))) {
        let mut state = running(60);
        for i in from..from + 120 {
            let mut swapped = raw(&standing(i as f64 / 60.0), i);
            swap(&mut swapped, pairs);
            assert!(feed(&mut state, &swapped).is_some(), "{pairs:?} after {from}: frame {i} came through");
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    #[test]
    fn f001_f002_frame_with_nan_or_infinity_is_dropped(slot in 0usize..188, bits: u32, sign: bool, nan: bool) {
        let value = if nan { f32::from_bits(bits | 0x7fc0_0000) } else { f32::INFINITY.copysign(if sign { 1.0 } else { -1.0 }) };
        let mut state = running(5);
        let mut bad = frame(5);
        *numbers(&mut bad)[slot] = value;
        prop_assert_eq!(feed(&mut state, &bad), Some(DropReason::NotFinite));
        prop_assert_eq!(feed(&mut state, &frame(6)), None, "and the next is taken");
    }

    #[test]
    fn f003_denormals_and_negative_zeros_count_as_zero(seeds in prop::collection::vec(any::<u32>(), 188)) {
        let mut odd = frame(0);
        for (number, seed) in numbers(&mut odd).into_iter().zip(seeds) {
            if *number == 0.0 {
                *number = f32::from_bits(seed & 0x807f_ffff);
            }
        }
        let plain = accepted(&mut State::default(), &frame(0)).expect("accepted");
        let odd = accepted(&mut State::default(), &odd).expect("accepted");
        prop_assert_eq!(odd.limbs.map(|q| q.map(f32::to_bits)), plain.limbs.map(|q| q.map(f32::to_bits)));
        prop_assert_eq!(odd.positions.map(|p| p.map(f32::to_bits)), plain.positions.map(|p| p.map(f32::to_bits)));
    }

    #[test]
    fn f004_quaternion_off_unit_is_renormalised_or_dropped(joint in 0usize..22, error in -0.999f32..3.0, small in -9e-4f32..9e-4) {
        let mut state = running(5);
        let (good, mut off) = (frame(5), frame(5));
        off.rotations[joint] = off.rotations[joint].map(|c| c * (1.0 + small));
        let plain = accepted(&mut state.clone(), &good).expect("accepted");
        let person = accepted(&mut state.clone(), &off).expect("accepted");
        for (limb, plain) in person.limbs.iter().zip(&plain.limbs) {
            prop_assert!((limb.iter().map(|c| f64::from(c * c)).sum::<f64>().sqrt() - 1.0).abs() < 1e-6);
            prop_assert!(read(*limb).angle_to(&read(*plain)) < 1e-5);
        }
        let error = if error.abs() < 1.1e-3 { 1.1e-3 } else { error };
        off.rotations[joint] = good.rotations[joint].map(|c| c * (1.0 + error));
        prop_assert_eq!(feed(&mut state, &off), Some(DropReason::NotUnit));
    }

    #[test]
    fn f005_quaternion_signs_hide_no_frozen_tracker(flips in prop::collection::vec(any::<u32>(), 20)) {
        let (mut state, mut other) = (running(5), running(5));
        for (i, flips) in (5..).zip(flips) {
            let plain = frame(5);
            let mut plain = RawSkeleton { header: frame(i).header, ..plain };
            plain.rotations[..SMPL_JOINTS].iter_mut().for_each(|q| *q = store(read(*q)));
            let mut flipped = plain;
            for joint in 0..SMPL_JOINTS {
                if flips & 1 << joint != 0 {
                    flipped.rotations[joint] = flipped.rotations[joint].map(|c| -c);
                }
            }
            let (a, b) = (accepted(&mut state, &plain), accepted(&mut other, &flipped));
            prop_assert_eq!(a.map(|a| a.limbs), b.map(|b| b.limbs));
        }
        prop_assert!(state.dropped(DropReason::Frozen) > 0);
        prop_assert_eq!(state.dropped(DropReason::Frozen), other.dropped(DropReason::Frozen));
    }

}
