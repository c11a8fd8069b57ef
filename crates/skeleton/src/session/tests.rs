//! The bounds from frame to frame, to the frame, the nanosecond and the millimetre.

use super::*;
use messages::{HingeCalibration, Layout, SMPL_JOINTS};

/// Somebody in a T-pose who looks along x, in the order of SMPL-22.
const T_POSE: [[f32; 3]; SMPL_JOINTS] = [
    [0.0, 0.0, 1.0],
    [0.0, 0.09, 0.93],
    [0.0, -0.09, 0.93],
    [0.0, 0.0, 1.1],
    [0.0, 0.09, 0.5],
    [0.0, -0.09, 0.5],
    [0.0, 0.0, 1.2],
    [0.0, 0.09, 0.08],
    [0.0, -0.09, 0.08],
    [0.0, 0.0, 1.3],
    [0.15, 0.09, 0.08],
    [0.15, -0.09, 0.08],
    [0.0, 0.0, 1.45],
    [0.0, 0.07, 1.42],
    [0.0, -0.07, 1.42],
    [0.0, 0.0, 1.55],
    [0.0, 0.18, 1.42],
    [0.0, -0.18, 1.42],
    [0.0, 0.46, 1.42],
    [0.0, -0.46, 1.42],
    [0.0, 0.72, 1.42],
    [0.0, -0.72, 1.42],
];
const MS: u64 = 1_000_000;

fn person(change: impl Fn(&mut [[f32; 3]; SMPL_JOINTS])) -> Person {
    let mut positions = T_POSE;
    change(&mut positions);
    Person {
        positions,
        rotations: [[0.0, 0.0, 0.0, 1.0]; SMPL_JOINTS],
        has_rotations: false,
        calibration: HingeCalibration::ZERO,
        usable: (1 << SMPL_JOINTS) - 1,
    }
}

fn good() -> Person {
    person(|_| {})
}

/// Feet that point backwards.
fn turned_feet() -> Person {
    person(|p| [Smpl::LeftFoot, Smpl::RightFoot].iter().for_each(|&foot| p[foot as usize][0] = -0.15))
}

/// A frame of capture time `ns` and this number.
fn frame(ns: u64, sequence: u64) -> RawSkeleton {
    let mut raw = RawSkeleton::ZERO;
    (raw.header.origin, raw.header.sequence, raw.header.incarnation) = (Stamp(ns), sequence, 1);
    raw
}

/// Frames of this person, from a session that has seen `before` good ones, until one is refused; its number from 1.
fn refused_after(before: u32, bad: &Person) -> u32 {
    let mut session = Session::new(&frame(0, 0));
    (0..before).for_each(|_| assert_eq!(session.check_posture(&good()), Ok(())));
    (1..1000).find(|_| session.check_posture(bad).is_err()).unwrap_or(u32::MAX)
}

#[test]
fn evidence_on_sides_is_a_mean_of_thirty_frames() {
    let of = |person: &Person| chirality(&person.positions).expect("a trunk");
    let hips = person(|p| p.swap(Smpl::LeftHip as usize, Smpl::RightHip as usize));
    let (was, feet, sides) = (of(&good()), of(&turned_feet()), of(&hips));
    assert!((was.sides - 1.0).abs() < 1e-6 && (sides.sides + 1.0).abs() < 1e-6);
    assert!((was.front - 2.0).abs() < 0.02 && (feet.front + 2.0).abs() < 0.02, "{was:?} {feet:?}");
    // The mean after n frames of b that follow many of a is b + (a - b) (29/30)^n.
    let below = |a: f64, b: f64, least: f64| (1..).find(|&n| b + (a - b) * (29.0_f64 / 30.0).powi(n) < least);
    let (by_feet, by_hips) = (below(was.front, feet.front, -1.0), below(1.0, -1.0, -0.3));
    assert_eq!((by_feet, by_hips), (Some(42), Some(31)));
    assert_eq!((refused_after(100, &turned_feet()), refused_after(100, &hips)), (42, 31));
    // The first frame stands for all before it.
    assert_eq!((refused_after(0, &turned_feet()), refused_after(0, &hips)), (1, 1));
}

#[test]
fn legs_that_are_not_seen_say_nothing() {
    let mut session = Session::new(&frame(0, 0));
    for hidden in [Smpl::LeftKnee, Smpl::RightAnkle, Smpl::LeftFoot] {
        let mut bad = turned_feet();
        bad.usable &= !(1 << hidden as u32);
        (0..100).for_each(|n| assert_eq!(session.check_posture(&bad), Ok(()), "frame {n} without {hidden:?}"));
    }
    // Nothing was known of them: the mean begins at 0, and is -2 + 2 (29/30)^n.
    let refused = (1..1000).find(|_| session.check_posture(&turned_feet()).is_err());
    assert_eq!(refused, (1..1000).find(|&n| -2.0 + 2.0 * (29.0_f64 / 30.0).powi(n) < -1.0));
}

#[test]
fn knees_that_bend_backwards_are_a_mirror_image_too() {
    let bend = |to: f32| {
        person(move |p| {
            for (ankle, foot) in [(Smpl::LeftAnkle, Smpl::LeftFoot), (Smpl::RightAnkle, Smpl::RightFoot)] {
                p[ankle as usize] = [to, T_POSE[ankle as usize][1], 0.5];
                p[foot as usize] = [to, T_POSE[ankle as usize][1], 0.4];
            }
        })
    };
    // Thigh down and shin to the back: 1 for each leg; a foot that points down says little.
    let front = |person: &Person| chirality(&person.positions).expect("a trunk").front;
    let (back, forth) = (front(&bend(-0.4)), front(&bend(0.4)));
    assert!((back - forth - 4.0).abs() < 1e-6 && back > 2.0 && forth < -1.5, "{back} {forth}");
    let one = person(|p| p[Smpl::LeftAnkle as usize] = [-0.4, 0.09, 0.5]);
    assert!(front(&one) > front(&good()), "one knee alone");
}

#[test]
fn evidence_lasts_for_fifty_milliseconds_without_a_frame() {
    let config = Config { frozen_after_ns: 0, ..Config::default() };
    for (gap_ns, refused) in [(50 * MS, false), (50 * MS + 1, true)] {
        let mut session = Session::new(&frame(0, 0));
        for (n, person) in [good(), good(), turned_feet()].iter().enumerate() {
            let at = 1 + n as u64 * gap_ns;
            let outcome = session.check(&config, Stamp(at), &frame(at, n as u64), person);
            assert_eq!(outcome.is_err(), refused && n == 2, "frame {n}, {gap_ns} ns apart");
        }
    }
}

#[test]
fn a_person_is_forgotten_after_more_than_the_gap_and_frames_are_not() {
    let config = Config::default();
    for (gap_ns, forgotten) in [(config.gap_ns, false), (config.gap_ns + 1, true)] {
        let mut session = Session::new(&frame(0, 0));
        assert_eq!(session.check_order(&config, &frame(5, 1)), Ok(false));
        session.moved = true;
        assert_eq!(session.check_order(&config, &frame(5 + gap_ns, 2)), Ok(forgotten));
        assert_eq!(session.moved, !forgotten);
    }
    let mut session = Session::new(&frame(0, 0));
    assert_eq!(session.check_order(&config, &frame(50, 7)), Ok(false));
    session.forget(&frame(50, 7));
    assert_eq!(session.check_order(&config, &frame(60, 7)), Err(DropReason::Duplicate), "the number was seen");
    assert_eq!(session.check_order(&config, &frame(50, 8)), Err(DropReason::Duplicate), "the time was seen");
    assert_eq!(session.check_order(&config, &frame(40, 8)), Err(DropReason::Backwards));
    assert_eq!(session.check_order(&config, &frame(60, 6)), Err(DropReason::Backwards));
    assert_eq!(session.check_order(&config, &frame(60, 8)), Ok(false));
}

/// A body whose limbs are all of this length.
fn limbs(length: f64, ns: u64) -> Body {
    Body { origin: Stamp(ns), arms: Default::default(), lengths: [Some(length); LIMBS] }
}

#[test]
fn lengths_are_learnt_in_the_first_second_and_no_longer() {
    let config = Config::default();
    let mut session = Session::new(&frame(0, 0));
    let mut see = |ms: u64, length: f64| session.check_lengths(&config, &limbs(length, 1 + ms * MS));
    // 50 frames of 1 and 50 of 1.04: the mean is 1.02.
    for n in 0..100 {
        assert_eq!(see(n * 10, if n < 50 { 1.0 } else { 1.04 }), Ok(()), "frame {n}");
    }
    assert_eq!((see(1000, 1.0709), see(1010, 1.0711)), (Ok(()), Err(DropReason::LengthChange)));
    assert_eq!((see(1020, 0.9691), see(1030, 0.9689)), (Ok(()), Err(DropReason::LengthChange)));
    // Ten seconds of another length, near enough, teach nothing.
    (0..1000).for_each(|n| assert_eq!(see(1040 + n * 10, 1.06), Ok(())));
    assert_eq!(see(20_000, 1.0711), Err(DropReason::LengthChange));
}

#[test]
fn a_length_at_its_bound_is_within_it() {
    let config = Config::default();
    let mut session = Session::new(&frame(0, 0));
    let learnt = 1 + config.gap_ns;
    for (ns, length, within) in
        [(1, 20.0, true), (learnt, 21.0, true), (learnt, 21.000_001, false), (learnt, 19.0, true)]
    {
        assert_eq!(session.check_lengths(&config, &limbs(length, ns)).is_ok(), within, "{length}");
    }
}

#[test]
fn a_limb_that_is_not_seen_is_neither_judged_nor_learnt() {
    let config = Config::default();
    let mut session = Session::new(&frame(0, 0));
    let mut partly = limbs(2.0, 1);
    partly.lengths[3] = None;
    assert_eq!(session.check_lengths(&config, &partly), Ok(()));
    assert_eq!(session.learnt, 0, "not every limb was there");
    assert_eq!(session.check_lengths(&config, &limbs(1.0, 2)), Ok(()));
    let mut one = limbs(1.0, 3);
    one.lengths = [None, None, Some(1.06), None];
    assert_eq!(session.check_lengths(&config, &one), Err(DropReason::LengthChange));
    one.lengths[2] = Some(1.04);
    assert_eq!(session.check_lengths(&config, &one), Ok(()));
}

#[test]
fn a_step_is_bounded_by_speed_by_length_and_by_noise() {
    let config = Config::default();
    // 10 m/s, at most 0.15 m for each thirtieth of a second, at least 30 mm.
    for (ns, most) in [(16_666_667, 0.15), (100 * MS, 0.45), (5 * MS, 0.05), (MS, 0.03), (12 * MS, 0.12)] {
        for (step, jumps) in [(most - 1e-3, false), (most + 1e-3, true)] {
            let (mut was, mut is) = (limbs(1.0, 1), limbs(1.0, 1 + ns));
            (was.arms[1][2].x, is.arms[1][2].x) = (0.5, 0.5 + step);
            assert_eq!(teleported(&config, &good(), &was, &is), jumps, "{step} m in {ns} ns");
        }
    }
    let (mut was, mut is) = (limbs(1.0, 1), limbs(1.0, 1 + MS));
    (was.arms[0][1].y, is.arms[0][1].y) = (-NOISE_M, 0.0);
    assert!(!teleported(&config, &good(), &was, &is), "noise, to the bit");
    is.arms[0][1].y = 2.0;
    assert!(teleported(&config, &good(), &was, &is));
    let mut unseen = good();
    unseen.usable &= !(1 << Smpl::LeftElbow as u32);
    assert!(!teleported(&config, &unseen, &was, &is), "nobody vouches for it");
    was.arms[0][1].y = 0.0;
    assert!(!teleported(&config, &good(), &was, &is), "it was not seen before");
    for (length, refused) in [(51.0, false), (51.000_001, true), (49.0, false), (48.999_999, true)] {
        let stepped = check_length_steps(&config, &limbs(50.0, 1), &limbs(length, 2));
        assert_eq!(stepped.is_err(), refused, "from 50 to {length}");
    }
}

#[test]
fn a_payload_is_frozen_from_its_hundred_milliseconds_to_its_second() {
    let config = Config::default();
    let mut session = Session::new(&frame(0, 0));
    let mut see = |ns: u64, payload: u64| session.check_frozen(&config, Stamp(1 + ns), payload);
    assert_eq!((see(0, 1), see(1, 2), see(2, 2)), (Ok(()), Ok(()), Ok(())), "it moved, and stands from now");
    assert_eq!((see(100 * MS + 1, 2), see(100 * MS + 2, 2)), (Ok(()), Err(DropReason::Frozen)));
    assert_eq!((see(1000 * MS + 2, 2), see(1000 * MS + 3, 2)), (Err(DropReason::Frozen), Ok(())));
    let off = Config { frozen_after_ns: 0, ..config };
    let mut session = Session::new(&frame(0, 0));
    let mut see = |ns: u64, payload: u64| session.check_frozen(&off, Stamp(1 + ns), payload);
    assert_eq!((see(0, 1), see(1, 2)), (Ok(()), Ok(())));
    (2..50).for_each(|n| assert_eq!(see(n * 10 * MS, 2), Ok(()), "it is turned off"));
}

#[test]
fn every_bit_of_a_posture_counts() {
    let still = payload_hash(&good());
    for bit in 0..32 {
        // The hash begins with bits that are set: none may hide one of the payload.
        let flip = |x: &mut f32| *x = f32::from_bits(x.to_bits() ^ 1 << bit);
        let first = person(|p| flip(&mut p[0][0]));
        let last = person(|p| flip(&mut p[21][2]));
        let mut turned = good();
        flip(&mut turned.rotations[7][2]);
        let all = [still, payload_hash(&first), payload_hash(&last), payload_hash(&turned)];
        assert!((0..4).all(|i| (0..i).all(|j| all[i] != all[j])), "bit {bit}: {all:x?}");
    }
}
