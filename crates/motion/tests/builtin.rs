//! Tests that the built-in motion, loops and upsampling are human, smooth and slow enough.

use messages::{HingeCalibration, Layout, Skeleton, Stamp, skeleton_flag};
use motion::{
    CalibrationMode, Frame, Motion, builtin, builtin_named, calibrate, limbs, loop_blend, raw_frame, upsample,
};
use nalgebra::{Quaternion, UnitQuaternion, Vector3};

fn rotation(q: [f32; 4]) -> UnitQuaternion<f64> {
    let [x, y, z, w] = q.map(f64::from);
    UnitQuaternion::new_normalize(Quaternion::new(w, x, y, z))
}

/// Shows these frames, in a loop. `see` gets each person. Returns the number of accepted frames.
fn accepted(motion: &Motion, frames: usize, mut see: impl FnMut(usize, &Skeleton)) -> u64 {
    let calibration = calibrate(motion, CalibrationMode::First10s);
    let mut state = skeleton::State::default();
    for i in 0..frames {
        let mut raw = raw_frame(motion, i, &calibration);
        raw.header.sequence = i as u64 + 1;
        raw.header.origin = Stamp(1 + (i as f64 * 1e9 / motion.frame_rate_hz) as u64);
        let input = skeleton::Input { raw: &raw, stored: None };
        let out = skeleton::tick(&skeleton::Config::default(), &mut state, raw.header.origin, input);
        if let Some(skeleton) = out.skeleton {
            let limbs = skeleton_flag::ALL | skeleton_flag::CALIBRATED;
            assert_eq!(skeleton.flags & limbs, limbs);
            see(i, &skeleton);
        }
    }
    state.accepted()
}

/// Largest angular speed of a limb between successive frames, rad/s, including the seam.
fn fastest(motion: &Motion) -> f64 {
    let limbs = limbs(motion, &calibrate(motion, CalibrationMode::Clip));
    let next = limbs.iter().cycle().skip(1);
    let angles = limbs.iter().zip(next).flat_map(|(a, b)| (0..4).map(|l| rotation(a[l]).angle_to(&rotation(b[l]))));
    angles.fold(0.0, f64::max) * motion.frame_rate_hz
}

#[test]
fn builtin_motion_is_accepted_and_within_speed_of_robot() {
    let motion = builtin();
    assert!((20.0..=25.0).contains(&motion.duration_s()), "{} s", motion.duration_s());
    // Played twice: the seam is as plausible as the rest.
    assert_eq!(accepted(&motion, 2 * motion.frames.len(), |_, _| ()), 2 * motion.frames.len() as u64);
    let fastest = fastest(&motion);
    assert!(fastest < 3.0, "a limb turns with {fastest:.2} rad/s");
    assert!(fastest > 1.0, "the demo sleeps: {fastest:.2} rad/s");
}

#[test]
fn motion_that_picks_up_a_box_shows_hands_and_head_before_it_reaches() {
    let motion = builtin_named("pick-and-place").expect("built in");
    assert_eq!(accepted(&motion, 2 * motion.frames.len(), |_, _| ()), 2 * motion.frames.len() as u64);
    let fastest = fastest(&motion);
    assert!((1.0..3.0).contains(&fastest), "a limb turns with {fastest:.2} rad/s");
    let known = skeleton_flag::HAND[0] | skeleton_flag::HAND[1] | skeleton_flag::HEAD;
    let (mut first, mut tilt, mut hands_m) = (None, 0.0_f64, f32::INFINITY);
    accepted(&motion, motion.frames.len(), |i, person| {
        if person.flags & known == known {
            first.get_or_insert(i);
            let ahead = rotation(person.head) * Vector3::x();
            tilt = tilt.max((-ahead.z).asin());
        }
        hands_m = hands_m.min((Vector3::from(person.positions[20]) - Vector3::from(person.positions[21])).norm());
    });
    // The arms move from 1 s on. The box is reached for at 12 s.
    assert!(first.is_some_and(|frame| frame < 10 * 60), "hands and head from frame {first:?} on");
    assert!(tilt > 0.3, "the person looks down by {tilt} rad");
    assert!((0.1..0.4).contains(&hands_m), "the wrists come within {hands_m} m");
}

#[test]
fn calibrated_limbs_match_rotations_of_builtin_motion() {
    let motion = builtin();
    let limbs = limbs(&motion, &calibrate(&motion, CalibrationMode::First10s));
    for (frame, limbs) in motion.frames.iter().zip(&limbs) {
        for (limb, joint) in [(0, 16), (2, 17), (1, 20), (3, 21)] {
            let angle = rotation(frame.rotations[joint]).angle_to(&rotation(limbs[limb]));
            // Pronation counts from its mean, which is a few degrees off the T-pose's.
            let bound = if joint < 20 { 0.002 } else { 0.12 };
            assert!(angle < bound, "joint {joint}: {angle} rad");
        }
    }
    // The motion begins and ends in the T-pose: identity.
    for limb in [0, 2] {
        assert!(rotation(limbs[0][limb]).angle() < 0.002);
    }
}

#[test]
fn upper_arms_without_calibration_are_5_degrees_off_at_most() {
    let motion = builtin();
    let with = limbs(&motion, &calibrate(&motion, CalibrationMode::Clip));
    let without = limbs(&motion, &HingeCalibration::ZERO);
    let mut sum = 0.0;
    for (a, b) in with.iter().zip(&without) {
        sum += rotation(a[0]).angle_to(&rotation(b[0])) + rotation(a[2]).angle_to(&rotation(b[2]));
    }
    let mean_deg = (sum / (2 * with.len()) as f64).to_degrees();
    assert!(mean_deg < 5.0, "{mean_deg:.2} degrees on average");
}

#[test]
fn looped_motion_has_no_jump_at_seam() {
    let mut motion = builtin();
    // Cut in the middle of a movement, with a person who walks away. The ends differ in pose, place and heading.
    motion.frames = motion.frames[100..700].to_vec();
    for (i, frame) in motion.frames.iter_mut().enumerate() {
        let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), i as f64 * 0.003);
        for joint in 0..22 {
            let p = turn * Vector3::from(frame.positions[joint]).cast::<f64>() + Vector3::x() * (i as f64 * 0.01);
            frame.positions[joint] = p.cast::<f32>().into();
            let q = turn * rotation(frame.rotations[joint]);
            frame.rotations[joint] = [q.i as f32, q.j as f32, q.k as f32, q.w as f32];
        }
    }
    assert!(fastest(&motion) > 30.0, "the cut is a jump before blending");
    let looped = loop_blend(&motion, 0.5);
    assert_eq!(looped.frames.len(), 570);
    // Two poses are at most pi apart. A minimum-jerk blend peaks at 1.875 times the mean speed: 11.8 rad/s.
    assert!(fastest(&looped) < 11.8, "{:.2} rad/s at the seam", fastest(&looped));
    assert_eq!(accepted(&looped, 2 * 570, |_, _| ()), 2 * 570);
}

#[test]
fn upsampled_motion_keeps_limb_lengths_at_60_hz() {
    let full = builtin();
    let mut slow = full.clone();
    slow.frames = full.frames.iter().step_by(3).copied().collect();
    slow.frame_rate_hz = 20.0;
    let fast = upsample(&slow);
    assert_eq!(fast.frame_rate_hz, 60.0);
    let length = |f: &Frame, a: usize, b: usize| (Vector3::from(f.positions[a]) - Vector3::from(f.positions[b])).norm();
    for (i, frame) in fast.frames.iter().enumerate() {
        for (a, b) in [(16, 18), (18, 20), (17, 19), (19, 21)] {
            assert!((length(frame, a, b) - length(&full.frames[0], a, b)).abs() < 1e-4);
        }
        let error = (Vector3::from(frame.positions[21]) - Vector3::from(full.frames[i].positions[21])).norm();
        assert!(error < 0.01, "frame {i}: the right wrist is {error} m off");
    }
    assert_eq!(upsample(&full), full, "60 Hz stays as it is");
    // The last frame comes, also at a rate that is the inverse of a time with six digits.
    for (count, hz, expected) in
        [(99, 24.0, 246), (99, 1.0 / 0.041667, 246), (61, 1.0 / 0.066_667, 241), (99, 7.0, 841)]
    {
        (slow.frames, slow.frame_rate_hz) = (full.frames[..count].to_vec(), hz);
        assert_eq!(upsample(&slow).frames.len(), expected, "{count} frames at {hz} Hz");
    }
}
