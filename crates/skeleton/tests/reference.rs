//! Choice of the hinges. No change between them makes a limb jump.

use crate::person::{Body, about, arm, mirror, person, raw, read, seen, store};
use messages::{
    CalibrationSource, HingeCalibration, LIMBS, Layout, Limb, RawSkeleton, Skeleton, Smpl, calibration_flag,
    skeleton_flag,
};
use nalgebra::UnitQuaternion;
use skeleton::{Calibration, Calibrator, Config, Input, LEAN_MAX_RAD, Pose, State, TORSO_LEAN_RAD, TPose, tick};

/// Frames per second.
const RATE: u64 = 60;

fn accept(state: &mut State, raw: &RawSkeleton, stored: Option<&Calibration>) -> Skeleton {
    let out = tick(&Config::default(), state, raw.header.origin.plus_ns(1_000_000), Input { raw, stored });
    out.skeleton.unwrap_or_else(|| panic!("frame {}: {:?}", raw.header.sequence, out.drop))
}

/// Joint angles of a person who moves shoulders, elbows and hands, for the left and the right arm.
fn angles(i: u64) -> [[f64; 5]; 2] {
    let t = i as f64 / RATE as f64;
    let arm = |lag: f64| {
        let wave = |period_s: f64| (std::f64::consts::TAU * (t / period_s) + lag).sin();
        [0.5 * wave(4.0), 0.5 + 0.4 * wave(5.0), 0.6 * wave(7.0), 0.9 + 0.7 * wave(3.0), 0.6 * wave(2.5)]
    };
    [arm(0.0), arm(1.0)]
}

/// The body as sent by a client whose joint frames have other rest orientations.
fn elsewhere(body: &Body) -> Body {
    let mut out = *body;
    for (joint, rotation) in out.1.iter_mut().enumerate() {
        let angle = 0.3 + 0.2 * joint as f64;
        *rotation = store(read(*rotation) * about(joint % 3, angle) * about((joint + 1) % 3, -angle));
    }
    out
}

fn moving(i: u64) -> Body {
    let [left, right] = angles(i);
    person(left, right)
}

fn degrees(a: [f32; 4], b: UnitQuaternion<f64>) -> f64 {
    read(a).angle_to(&b).to_degrees()
}

/// Largest step of a limb from frame to frame, deg.
#[derive(Default)]
struct Steps {
    before: Option<[[f32; 4]; LIMBS]>,
    largest_deg: f64,
}

impl Steps {
    fn add(&mut self, limbs: [[f32; 4]; LIMBS]) {
        let before = self.before.replace(limbs).unwrap_or(limbs);
        for (was, is) in before.into_iter().zip(limbs) {
            self.largest_deg = self.largest_deg.max(degrees(was, read(is)));
        }
    }
}

#[test]
fn session_learns_hinges_within_10_s_without_jump() {
    let (mut state, mut steps, mut truth) = (State::default(), Steps::default(), Steps::default());
    let mut learnt_at = None;
    for i in 0..20 * RATE {
        let [left, right] = angles(i);
        let person = accept(&mut state, &raw(&elsewhere(&moving(i)), i), None);
        steps.add(person.limbs);
        let (upper_left, fore_left) = arm(left);
        let (upper_right, fore_right) = arm(right);
        let limbs = [upper_left, fore_left, mirror(upper_right), mirror(fore_right)];
        truth.add(limbs.map(store));
        if state.calibration() == CalibrationSource::Online {
            learnt_at.get_or_insert(i);
        }
        if i >= 10 * RATE {
            let error = |limb: Limb, truth| degrees(person.limbs[limb as usize], truth);
            assert!(error(Limb::LeftUpper, upper_left) < 0.5, "frame {i}");
            assert!(error(Limb::RightUpper, mirror(upper_right)) < 0.5, "frame {i}");
            assert_eq!(person.flags & skeleton_flag::CALIBRATED, skeleton_flag::CALIBRATED);
        }
    }
    let learnt_at = learnt_at.expect("it learnt");
    assert!((RATE / 2..10 * RATE).contains(&learnt_at), "after {learnt_at} frames");
    // Blending adds at most 90 degrees in 2 s, and the mean of the learnt hinges moves.
    let (largest_deg, own_deg) = (steps.largest_deg, truth.largest_deg);
    assert!(largest_deg < own_deg + 1.5, "{largest_deg} deg in a frame, the person {own_deg}");
}

#[test]
fn rotations_that_freeze_lose_their_calibration_without_jump() {
    let numb = |body: &Body| (body.0, [[0.0, 0.0, 0.0, 1.0]; 22]);
    let (mut state, mut steps) = (State::default(), Steps::default());
    for i in 0..30 * RATE {
        let person = accept(&mut state, &raw(&numb(&moving(i)), i), None);
        assert_eq!(state.calibration(), CalibrationSource::None, "frame {i}");
        assert_eq!(person.flags & (skeleton_flag::HAND[0] | skeleton_flag::HAND[1] | skeleton_flag::HEAD), 0);
    }
    // A tracker whose rotations froze after they were right: the learnt hinges lose their weight, and nothing jumps.
    let mut state = State::default();
    let frozen = elsewhere(&moving(10 * RATE)).1;
    for i in 0..60 * RATE {
        let (positions, rotations) = elsewhere(&moving(i));
        let rotations = if i < 10 * RATE { rotations } else { frozen };
        let limbs = accept(&mut state, &raw(&(positions, rotations), i), None).limbs;
        if i > 10 * RATE {
            steps.add(limbs);
        }
        if i == 10 * RATE {
            assert_eq!(state.calibration(), CalibrationSource::Online);
        }
    }
    assert_eq!(state.calibration(), CalibrationSource::None);
    assert!(steps.largest_deg < 4.0, "{} deg in a frame", steps.largest_deg);
}

/// Calibration of the client of [`elsewhere`].
fn measured() -> Calibration {
    let mut calibrator = Calibrator::default();
    for i in 0..10 * RATE {
        let (positions, rotations) = elsewhere(&moving(i));
        calibrator.add(&positions, &rotations, u32::MAX);
    }
    let hinges = calibrator.estimate();
    assert_eq!(hinges.flags, calibration_flag::ALL);
    Calibration { hinges, lengths_m: [0.3, 0.26, 0.3, 0.26], ..Calibration::NONE }
}

#[test]
fn stored_calibration_applies_from_first_frame_to_its_person() {
    let stored = measured();
    let frame = raw(&elsewhere(&moving(100)), 0);
    let [left, _] = angles(100);
    let mut state = State::default();
    let person = accept(&mut state, &frame, Some(&stored));
    assert_eq!(state.calibration(), CalibrationSource::Stored);
    assert!(degrees(person.limbs[0], arm(left).0) < 0.5);
    // Arms of another person.
    for (factor, source) in [(1.1, CalibrationSource::Stored), (1.3, CalibrationSource::None)] {
        let other = Calibration { lengths_m: stored.lengths_m.map(|length| length * factor), ..stored };
        let mut state = State::default();
        accept(&mut state, &frame, Some(&other));
        assert_eq!(state.calibration(), source, "{factor}");
    }
    let mut state = State::default();
    accept(&mut state, &RawSkeleton { calibration: stored.hinges, ..frame }, Some(&stored));
    assert_eq!(state.calibration(), CalibrationSource::Client);
    // Another session counts as another person until a new decision.
    let mut other = raw(&elsewhere(&moving(101)), 1);
    other.session_nonce = 8;
    assert!(seen(&mut state, other.header.origin, &other).is_none() && state.calibration() == CalibrationSource::None);
}

#[test]
fn stored_lean_tilts_trunk_within_its_bound() {
    let bent = [0.0, 0.0, 0.0, 1.0, 0.0];
    let frame = raw(&person(bent, bent), 0);
    let upright = accept(&mut State::default(), &frame, None).limbs;
    for (lean_rad, effect_rad) in [(TORSO_LEAN_RAD, 0.0), (0.2, 0.1), (2.0, LEAN_MAX_RAD - TORSO_LEAN_RAD)] {
        let hinges = HingeCalibration::ZERO;
        let stored = Calibration { hinges, torso_lean_rad: lean_rad, ..Calibration::NONE };
        let limbs = accept(&mut State::default(), &frame, Some(&stored)).limbs;
        // If the trunk is assumed to lean back more, an arm to the side has turned about itself.
        let turned = about(1, -effect_rad) * read(upright[0]);
        assert!(degrees(limbs[0], turned) < 0.1, "{lean_rad}: {limbs:?}");
    }
}

/// A validated frame of `body` with number `i`, as `ingest` publishes it.
fn published(body: &Body, i: u64) -> Skeleton {
    let mut skeleton = Skeleton::ZERO;
    skeleton.header.origin = raw(body, i).header.origin;
    (skeleton.positions, skeleton.flags) = (body.0, skeleton_flag::ALL);
    skeleton
}

#[test]
fn held_t_pose_gives_lengths_and_lean() {
    let mut pose = TPose::default();
    assert_eq!(pose.measured(), None);
    let sway = |i: u64| 0.02 * (i as f64 * 0.1).sin();
    let t_pose = |i: u64| person([sway(i), 0.1, 0.0, 0.1, 0.0], [sway(i), 0.1, 0.0, 0.1, 0.0]);
    for i in 0..=2 * RATE {
        let held = pose.add(&published(&t_pose(i), i));
        assert_eq!(held, Pose::Held(i * 16_666_667), "frame {i}");
    }
    let measured = pose.measured().expect("it was held");
    for (length, truth) in measured.lengths_m.into_iter().zip([0.3, 0.26, 0.3, 0.26]) {
        assert!((length - truth).abs() < 1e-4);
    }
    assert!((measured.torso_lean_rad - TORSO_LEAN_RAD).abs() < 1e-3);
    // A person who moves or walks restarts the measurement.
    assert_eq!(pose.add(&published(&person([0.0, 0.9, 0.0, 0.1, 0.0], [0.0; 5]), 130)), Pose::ArmsNotOut);
    assert_eq!((pose.add(&published(&t_pose(131), 131)), pose.measured().is_some()), (Pose::Held(0), true));
    let mut away = published(&t_pose(132), 132);
    away.positions.iter_mut().for_each(|place| place[0] += 0.06);
    assert_eq!(pose.add(&away), Pose::Held(0));
    assert_eq!(pose.add(&published(&person([0.0; 5], [0.0, 0.0, 0.0, 1.0, 0.0]), 133)), Pose::ArmsNotOut, "bent");
    let mut leaning = published(&t_pose(134), 134);
    let back = about(1, -0.5);
    leaning.positions =
        leaning.positions.map(|p| (back * nalgebra::Vector3::from(p).cast::<f64>()).cast::<f32>().into());
    assert_eq!(pose.add(&leaning), Pose::Leaning);
    let mut unseen = published(&t_pose(135), 135);
    unseen.flags = skeleton_flag::LIMB[0];
    assert_eq!(pose.add(&unseen), Pose::Unseen);
    let mut nowhere = published(&t_pose(136), 136);
    nowhere.positions[Smpl::LeftShoulder as usize] = [f32::NAN; 3];
    assert_eq!((pose.add(&nowhere), pose.measured()), (Pose::Unseen, None));
}

/// The body with hands bent against their forearms, and with a turned head.
fn bent(body: &Body, hands: [UnitQuaternion<f64>; 2], head: UnitQuaternion<f64>) -> Body {
    let mut out = *body;
    for (side, bend) in hands.into_iter().enumerate() {
        let wrist = Smpl::LeftWrist as usize + side;
        out.1[wrist] = store(read(out.1[wrist]) * bend);
    }
    out.1[Smpl::Head as usize] = store(head * read(out.1[Smpl::Head as usize]));
    out
}

#[test]
fn hands_and_head_are_those_of_the_person_whatever_the_rig() {
    let mut state = State::default();
    let wave = |i: u64, period_s: f64| (std::f64::consts::TAU * i as f64 / RATE as f64 / period_s).sin();
    let mut seen = [0; 3];
    for i in 0..30 * RATE {
        let hands = [about(0, 0.5 * wave(i, 1.7)), about(2, 0.4 * wave(i, 2.3))];
        let head = about(2, 0.6 * wave(i, 2.0)) * about(1, 0.2 * wave(i, 3.0));
        let person = accept(&mut state, &raw(&elsewhere(&bent(&moving(i), hands, head)), i), None);
        if i < 20 * RATE {
            continue;
        }
        // Left and right: the hand against its own forearm.
        for side in 0..2 {
            assert_ne!(person.flags & skeleton_flag::HAND[side], 0, "frame {i}");
            let fore = read(person.limbs[2 * side + 1]);
            let off = degrees(person.hands[side], fore * hands[side]);
            assert!(off < 4.0, "frame {i}: hand {side} is {off} degrees off");
            seen[side] += 1;
        }
        let off = degrees(person.head, head);
        assert!(off < 4.0, "frame {i}: the head is {off} degrees off");
        seen[2] += 1;
    }
    assert_eq!(seen, [10 * RATE; 3]);
}

#[test]
fn person_without_rotations_has_neither_hands_nor_head() {
    let mut state = State::default();
    for i in 0..10 * RATE {
        let mut raw = raw(&moving(i), i);
        raw.flags = 0;
        let person = accept(&mut state, &raw, None);
        let known = skeleton_flag::HAND[0] | skeleton_flag::HAND[1] | skeleton_flag::HEAD;
        assert_eq!(person.flags & known, 0, "frame {i}");
    }
}
