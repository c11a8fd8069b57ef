//! Bounds from frame to frame, exact to the frame, the nanosecond and the millimetre.

use super::*;
use crate::steps::{NOISE_M, jumped, lengths_stepped};
use messages::{HingeCalibration, Layout, SMPL_JOINTS};

/// A person in a T-pose who looks along x, in the order of SMPL-22.
const T_POSE: [[f32; SMPL_JOINTS]; 3] = [
    [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.15, 0.15, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
    [
        0.0, 0.09, -0.09, 0.0, 0.09, -0.09, 0.0, 0.09, -0.09, 0.0, 0.09, -0.09, 0.0, 0.07, -0.07, 0.0, 0.18, -0.18,
        0.46, -0.46, 0.72, -0.72,
    ],
    [
        1.0, 0.93, 0.93, 1.1, 0.5, 0.5, 1.2, 0.08, 0.08, 1.3, 0.08, 0.08, 1.45, 1.42, 1.42, 1.55, 1.42, 1.42, 1.42,
        1.42, 1.42, 1.42,
    ],
];
const MS: u64 = 1_000_000;
/// 30 periods are half a second.
const PERIOD_NS: u64 = 500 * MS / 30;

fn person(change: impl Fn(&mut [[f32; 3]; SMPL_JOINTS])) -> Person {
    let mut positions = std::array::from_fn(|joint| T_POSE.map(|axis| axis[joint]));
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

/// A person whose feet point backwards.
fn turned_feet() -> Person {
    person(|p| [Smpl::LeftFoot, Smpl::RightFoot].iter().for_each(|&foot| p[foot as usize][0] = -0.15))
}

/// A frame with capture time `ns` and this sequence number.
fn frame(ns: u64, sequence: u64) -> RawSkeleton {
    let mut raw = RawSkeleton::ZERO;
    (raw.header.origin, raw.header.sequence, raw.header.incarnation) = (Stamp(ns), sequence, 1);
    raw
}

/// Feeds frames of `bad` to a session after `before` good ones. Returns the number of the first refused frame, from 1.
fn refused_after(before: u32, bad: &Person) -> u32 {
    let mut session = Session::new(&frame(0, 0));
    (0..before).for_each(|_| assert_eq!(session.check_posture(&good(), PERIOD_NS), Ok(())));
    (1..1000).find(|_| session.check_posture(bad, PERIOD_NS).is_err()).unwrap_or(u32::MAX)
}

#[test]
fn chirality_evidence_is_a_mean_over_half_a_second() {
    let of = |person: &Person| chirality(&person.positions).expect("a trunk");
    let hips = person(|p| p.swap(Smpl::LeftHip as usize, Smpl::RightHip as usize));
    let (was, feet, sides) = (of(&good()), of(&turned_feet()), of(&hips));
    assert!((was.sides - 1.0).abs() < 1e-6 && (sides.sides + 1.0).abs() < 1e-6);
    assert!((was.front - 2.0).abs() < 0.02 && (feet.front + 2.0).abs() < 0.02, "{was:?} {feet:?}");
    // The mean after n frames of b that follow many of a is b + (a - b) (29/30)^n.
    let below = |a: f64, b: f64, least: f64| (1..).find(|&n| b + (a - b) * (29.0_f64 / 30.0).powi(n) < least);
    let (by_feet, by_hips) = (below(was.front, feet.front, -1.0), below(1.0, -1.0, -0.3));
    assert_eq!((by_feet, by_hips), (Some(41), Some(31)));
    assert_eq!((refused_after(100, &turned_feet()), refused_after(100, &hips)), (41, 31));
    // The first frame counts for all before it.
    assert_eq!((refused_after(0, &turned_feet()), refused_after(0, &hips)), (1, 1));
}

#[test]
fn unseen_legs_give_no_chirality_evidence() {
    let mut session = Session::new(&frame(0, 0));
    for hidden in [Smpl::LeftKnee, Smpl::RightAnkle, Smpl::LeftFoot] {
        let mut bad = turned_feet();
        bad.usable &= !(1 << hidden as u32);
        (0..100)
            .for_each(|n| assert_eq!(session.check_posture(&bad, PERIOD_NS), Ok(()), "frame {n} without {hidden:?}"));
    }
    // Nothing is known of the legs: the mean starts at 0, and is -2 + 2 (29/30)^n.
    let refused = (1..1000).find(|_| session.check_posture(&turned_feet(), PERIOD_NS).is_err());
    assert_eq!(refused, (1..1000).find(|&n| -2.0 + 2.0 * (29.0_f64 / 30.0).powi(n) < -1.0));
}

#[test]
fn knees_that_bend_backwards_lower_chirality_evidence() {
    let bend = |to: f32| {
        person(move |p| {
            for (ankle, foot) in [(Smpl::LeftAnkle, Smpl::LeftFoot), (Smpl::RightAnkle, Smpl::RightFoot)] {
                p[ankle as usize] = [to, T_POSE[1][ankle as usize], 0.5];
                p[foot as usize] = [to, T_POSE[1][ankle as usize], 0.4];
            }
        })
    };
    // Thigh down and shin to the back give 1 for each leg, and so does a foot that points down from such a shin.
    let of = |person: &Person| chirality(&person.positions).expect("a trunk");
    let [back, forth] = [-0.4, 0.4].map(|to| of(&bend(to)));
    for (evidence, front) in [(back, 4.0), (forth, -4.0)] {
        assert!((evidence.front - front).abs() < 0.01 && (evidence.weight - 4.0).abs() < 0.01, "{evidence:?}");
    }
    assert!(forth.is_mirrored() && !back.is_mirrored());
    let one = person(|p| p[Smpl::LeftAnkle as usize] = [-0.4, 0.09, 0.5]);
    assert!(of(&one).front > of(&good()).front, "one knee alone");
}

#[test]
fn straight_knees_and_folded_legs_prove_no_mirror_image() {
    let legs = |knee: [f32; 2], ankle: [f32; 2], foot: [f32; 2]| {
        let body = person(move |p| {
            let chains = [
                [Smpl::LeftHip, Smpl::LeftKnee, Smpl::LeftAnkle, Smpl::LeftFoot],
                [Smpl::RightHip, Smpl::RightKnee, Smpl::RightAnkle, Smpl::RightFoot],
            ];
            for joints in chains {
                let [hip_x, side, hip_z] = p[joints[0] as usize];
                for (joint, [x, z]) in joints.into_iter().skip(1).zip([knee, ankle, foot]) {
                    p[joint as usize] = [hip_x + x, side, hip_z + z];
                }
            }
        });
        chirality(&body.positions).expect("a trunk")
    };
    // On the heels: thighs ahead, shins and insteps on the floor to the back.
    let kneels = legs([0.4, -0.1], [0.0, -0.15], [-0.15, -0.17]);
    assert!(kneels.front > 0.5, "{kneels:?}");
    // Knees that an estimate bends forward by ten degrees, and feet without length.
    let straight = legs([0.0, -0.43], [0.07, -0.83], [0.07, -0.83]);
    assert_eq!((straight.front, straight.weight), (0.0, 0.0));
    // A mirror image is one whether it stands or sits.
    for [knee, ankle, foot] in
        [[[0.0, -0.43], [0.0, -0.85], [-0.15, -0.87]], [[-0.42, 0.0], [-0.42, -0.43], [-0.57, -0.45]]]
    {
        let evidence = legs(knee, ankle, foot);
        assert!(evidence.is_mirrored(), "{evidence:?}");
    }
}

#[test]
fn chirality_evidence_is_forgotten_after_75_ms_without_frame() {
    let config = Config { frozen_after_ns: 0, ..Config::default() };
    for (gap_ns, refused) in [(75 * MS, false), (75 * MS + 1, true)] {
        let mut session = Session::new(&frame(0, 0));
        for (n, person) in [good(), good(), turned_feet()].iter().enumerate() {
            let at = 1 + n as u64 * gap_ns;
            let outcome = session.check(&config, Stamp(at), &frame(at, n as u64), person);
            assert_eq!(outcome.is_err(), refused && n == 2, "frame {n}, {gap_ns} ns apart");
        }
    }
}

#[test]
fn person_is_forgotten_after_gap_and_frame_order_is_not() {
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

#[test]
fn numbers_that_did_not_come_are_the_share_of_lost_frames() {
    let config = Config::default();
    let mut session = Session::new(&frame(0, 0));
    assert_eq!(session.lost_permille(), 0);
    let mut lost_after = |numbers: &[u64]| {
        for &number in numbers {
            session.check_order(&config, &frame(10 * number, number)).expect("in order");
        }
        session.lost_permille()
    };
    // The number of the first frame says nothing.
    assert_eq!(lost_after(&[7, 8, 9, 10]), 0);
    assert_eq!(lost_after(&[12]), 1000 / 6);
    assert_eq!(lost_after(&(13..=138).collect::<Vec<_>>()), 1000 / 128);
    assert_eq!(lost_after(&[139]), 0);
    assert_eq!(lost_after(&[1_000_000]), 1000 * 127 / 128);
}

/// A body whose limbs all have this length.
fn limbs(length: f64, ns: u64) -> Body {
    Body { origin: Stamp(ns), arms: Default::default(), lengths: [Some(length); LIMBS] }
}

/// Result for both arms, which must agree.
fn both(doubts: Doubts) -> Result<(), DropReason> {
    assert_eq!(doubts[0], doubts[1]);
    doubts[0].map_or(Ok(()), Err)
}

#[test]
fn limb_lengths_are_learnt_in_first_second_only() {
    let config = Config::default();
    let mut session = Session::new(&frame(0, 0));
    let mut see = |ms: u64, length: f64| both(session.check_lengths(&config, &limbs(length, 1 + ms * MS)));
    // 50 frames of 1 and 50 of 1.04: the mean is 1.02.
    for n in 0..100 {
        assert_eq!(see(n * 10, if n < 50 { 1.0 } else { 1.04 }), Ok(()), "frame {n}");
    }
    assert_eq!((see(1000, 1.0709), see(1010, 1.0711)), (Ok(()), Err(DropReason::LengthChange)));
    assert_eq!((see(1020, 0.9691), see(1030, 0.9689)), (Ok(()), Err(DropReason::LengthChange)));
    // Ten seconds of another length within the bound change nothing.
    (0..1000).for_each(|n| assert_eq!(see(1040 + n * 10, 1.06), Ok(())));
    assert_eq!(see(20_000, 1.0711), Err(DropReason::LengthChange));
}

#[test]
fn limb_length_at_its_bound_is_accepted() {
    let config = Config::default();
    let mut session = Session::new(&frame(0, 0));
    let learnt = 1 + config.learning_ns;
    for (ns, length, within) in
        [(1, 20.0, true), (learnt, 21.0, true), (learnt, 21.000_001, false), (learnt, 19.0, true)]
    {
        assert_eq!(both(session.check_lengths(&config, &limbs(length, ns))).is_ok(), within, "{length}");
    }
}

#[test]
fn unseen_limb_is_neither_checked_nor_learnt() {
    let config = Config::default();
    let mut session = Session::new(&frame(0, 0));
    let mut partly = limbs(2.0, 1);
    partly.lengths[3] = None;
    assert_eq!(session.check_lengths(&config, &partly), [None; 2]);
    assert_eq!(session.learnt, 0, "not every limb was there");
    assert_eq!(session.check_lengths(&config, &limbs(1.0, 2)), [None; 2]);
    let mut one = limbs(1.0, 3);
    one.lengths = [None, None, Some(1.06), None];
    assert_eq!(session.check_lengths(&config, &one), [None, Some(DropReason::LengthChange)]);
    one.lengths[2] = Some(1.04);
    assert_eq!(session.check_lengths(&config, &one), [None; 2]);
}

#[test]
fn step_beyond_joint_speed_length_or_noise_bound_is_a_jump() {
    let config = Config::default();
    let parts = [Which::Trunk, Which::Arm(1), Which::Arm(1)];
    for (place, speed) in [7.0, 10.0, 12.0].into_iter().enumerate() {
        // At 20, 30, 60 and 120 Hz, after a gap, and never below 30 mm.
        for ms in [50.0, 33.3, 16.7, 8.3, 250.0, 1.0] {
            let most = (speed * ms * 1e-3_f64).max(NOISE_M);
            for (step, jumps) in [(most - 1e-3, false), (most + 1e-3, true)] {
                let (mut was, mut is) = (limbs(1.0, 1), limbs(1.0, 1 + (ms * 1e6) as u64));
                (was.arms[1][place].x, is.arms[1][place].x) = (0.5, 0.5 + step);
                assert_eq!(jumped(&config, parts[place], &good(), &was, &is), jumps, "{place}: {step} m in {ms} ms");
                assert!(!jumped(&config, Which::Arm(0), &good(), &was, &is), "the other arm did nothing");
            }
        }
    }
    let left = Which::Arm(0);
    let (mut was, mut is) = (limbs(1.0, 1), limbs(1.0, 1 + MS));
    (was.arms[0][1].y, is.arms[0][1].y) = (-NOISE_M, 0.0);
    assert!(!jumped(&config, left, &good(), &was, &is), "noise, to the bit");
    is.arms[0][1].y = 2.0;
    assert!(jumped(&config, left, &good(), &was, &is));
    let mut unseen = good();
    unseen.usable &= !(1 << Smpl::LeftElbow as u32);
    assert!(!jumped(&config, left, &unseen, &was, &is), "nobody vouches for it");
    was.arms[0][1].y = 0.0;
    assert!(!jumped(&config, left, &good(), &was, &is), "it was not seen before");
    for (length, refused) in [(51.0, false), (51.000_001, true), (49.0, false), (48.999_999, true)] {
        for side in 0..2 {
            let stepped = lengths_stepped(&config, side, &limbs(50.0, 1), &limbs(length, 2));
            assert_eq!(stepped, refused, "from 50 to {length}");
        }
    }
}

/// Results for a left arm whose wrist is off by these distances, 30 frames a second.
fn wrists_off(off_m: &[f64]) -> Vec<Option<DropReason>> {
    let config = Config::default();
    let mut part = Part::default();
    let body = |n: usize, off_m: f64| {
        let mut body = limbs(1.0, 1 + n as u64 * 33 * MS);
        body.arms[0][2].x = 0.5 + off_m;
        body
    };
    part.used(&body(0, 0.0), true);
    let mut previous = body(0, 0.0);
    let judged = off_m.iter().zip(1..).map(|(&off_m, n)| {
        let body = body(n, off_m);
        let found = part.judge(&config, Which::Arm(0), &good(), &previous, &body);
        part.used(&body, found.is_none());
        previous = body;
        found
    });
    judged.collect()
}

#[test]
fn wrist_outlier_of_one_or_two_frames_returns_at_once() {
    let refused = |off_m: &[f64]| wrists_off(off_m).iter().map(Option::is_some).collect::<Vec<_>>();
    assert_eq!(refused(&[0.0, 0.6, 0.0, 0.0]), [false, true, false, false]);
    assert_eq!(refused(&[0.0, 0.6, -0.6, 0.0, 0.0]), [false, true, true, false, false]);
    // Three are no accident: frames of 80 ms must agree.
    assert_eq!(refused(&[0.6, -0.6, 0.6, 0.0, 0.0, 0.0, 0.0]), [true, true, true, true, true, true, false]);
    // The wrist stays where it jumped to.
    assert_eq!(refused(&[0.6; 5]), [true, true, true, false, false]);
    // No second return is accepted within half a second: the way back is a jump, too.
    assert_eq!(refused(&[0.6, 0.0, 0.6, 0.0, 0.0, 0.0, 0.0])[2..], [true, true, true, true, false]);
    let mut late = vec![0.6, 0.0];
    late.extend([0.0; 15]);
    late.extend([0.6, 0.0]);
    assert_eq!(refused(&late)[17..], [true, false]);
    assert!(wrists_off(&[0.6]).contains(&Some(DropReason::Teleport)));
}

/// Payload of frame `n`.
fn repeated(n: u64) -> Payload {
    Payload { arms: [n; 2], rest: n }
}

#[test]
fn motion_of_unused_arm_does_not_prevent_frozen_drop() {
    let config = Config::default();
    for (used, frozen) in [([true, true], false), ([false, true], true)] {
        let mut session = Session::new(&frame(0, 0));
        let mut see = |ms: u64, left: u64, rest: u64| {
            session.check_frozen(&config, Stamp(1 + ms * MS), &Payload { arms: [left, 0], rest }, used)
        };
        assert_eq!((see(0, 0, 0), see(1, 1, 1)), (Ok(()), Ok(())), "it moves");
        let last = (2..200).map(|ms| see(ms, ms, 1)).last();
        assert_eq!(last == Some(Err(DropReason::Frozen)), frozen, "{used:?}: only the left arm differs");
    }
}

#[test]
fn repeated_payload_is_dropped_from_100_ms_to_1_s() {
    let config = Config::default();
    let mut session = Session::new(&frame(0, 0));
    let mut see = |ns: u64, n: u64| session.check_frozen(&config, Stamp(1 + ns), &repeated(n), [true; 2]);
    assert_eq!((see(0, 1), see(1, 2), see(2, 2)), (Ok(()), Ok(()), Ok(())), "it moved, and stands from now");
    assert_eq!((see(100 * MS + 1, 2), see(100 * MS + 2, 2)), (Ok(()), Err(DropReason::Frozen)));
    assert_eq!((see(1000 * MS + 2, 2), see(1000 * MS + 3, 2)), (Err(DropReason::Frozen), Ok(())));
    let off = Config { frozen_after_ns: 0, ..config };
    let mut session = Session::new(&frame(0, 0));
    let mut see = |ns: u64, n: u64| session.check_frozen(&off, Stamp(1 + ns), &repeated(n), [true; 2]);
    assert_eq!((see(0, 1), see(1, 2)), (Ok(()), Ok(())));
    (2..50).for_each(|n| assert_eq!(see(n * 10 * MS, 2), Ok(()), "it is turned off"));
}

#[test]
fn payload_hash_changes_with_every_bit_of_posture() {
    let still = payload(&good());
    for bit in 0..32 {
        // The hash starts with bits that are set. None of them may hide a bit of the payload.
        let flip = |x: &mut f32| *x = f32::from_bits(x.to_bits() ^ 1 << bit);
        let first = person(|p| flip(&mut p[0][0]));
        let last = person(|p| flip(&mut p[21][2]));
        let mut turned = good();
        flip(&mut turned.rotations[7][2]);
        let all = [still, payload(&first), payload(&last), payload(&turned)];
        assert!((0..4).all(|i| (0..i).all(|j| all[i] != all[j])), "bit {bit}: {all:x?}");
    }
}
