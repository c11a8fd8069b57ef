//! A standing person of 1.75 m with two arms of given limb rotations, for tests.

use messages::{
    Header, HingeCalibration, Layout, RawSkeleton, SMPL_JOINTS, Skeleton, SkeletonLayout, Stamp, calibration_flag,
    raw_flag,
};
use nalgebra::{UnitQuaternion, Vector3};
use skeleton::{Config, DropReason, Input, State, tick};

/// Positions, m, and global rotations, x y z w.
pub(crate) type Body = ([[f32; 3]; SMPL_JOINTS], [[f32; 4]; SMPL_JOINTS]);

/// Rotation about axis 0 (x), 1 (y) or 2 (z).
pub(crate) fn about(axis: usize, angle: f64) -> UnitQuaternion<f64> {
    UnitQuaternion::from_axis_angle(&nalgebra::Unit::new_unchecked(Vector3::ith(axis, 1.0)), angle)
}

/// Upper arm and forearm (with pronation) of a left arm from shoulder angles, flexion and pronation, rad.
pub(crate) fn arm(q: [f64; 5]) -> (UnitQuaternion<f64>, UnitQuaternion<f64>) {
    let upper = about(2, -q[0]) * about(0, -q[1]) * about(1, q[2]);
    (upper, upper * about(2, -q[3]) * about(1, -q[4]))
}

/// Mirrors a left arm's rotation to the right arm: (x, y, z, w) -> (-x, y, -z, w).
pub(crate) fn mirror(q: UnitQuaternion<f64>) -> UnitQuaternion<f64> {
    UnitQuaternion::new_unchecked(nalgebra::Quaternion::new(q.w, -q.i, q.j, -q.k))
}

pub(crate) fn store(q: UnitQuaternion<f64>) -> [f32; 4] {
    [q.i as f32, q.j as f32, q.k as f32, q.w as f32]
}

pub(crate) fn read(q: [f32; 4]) -> UnitQuaternion<f64> {
    let [x, y, z, w] = q.map(f64::from);
    UnitQuaternion::new_normalize(nalgebra::Quaternion::new(w, x, y, z))
}

/// A person whose torso frame is the world's. Both arms are given as left arms.
pub(crate) fn person(left: [f64; 5], right: [f64; 5]) -> Body {
    let lean = -0.5 * skeleton::TORSO_LEAN_RAD.tan();
    let mut positions = [[0.0f32; 3]; SMPL_JOINTS];
    let standing: [[f64; 3]; 18] = include!("standing.in");
    for (position, place) in positions.iter_mut().zip(standing) {
        *position = place.map(|c| c as f32);
    }
    let mut rotations = [[0.0, 0.0, 0.0, 1.0]; SMPL_JOINTS];
    for (side, q) in [left, right].into_iter().enumerate() {
        let (upper, fore) = arm(q);
        let (sign, upper, fore) = if side == 0 { (1.0, upper, fore) } else { (-1.0, mirror(upper), mirror(fore)) };
        let mut at = Vector3::from(positions[16 + side]).cast::<f64>();
        for (joint, rotation, length) in [(18, upper, 0.3), (20, fore, 0.26)] {
            at += rotation * Vector3::y() * (sign * length);
            positions[joint + side] = [at.x as f32, at.y as f32, at.z as f32];
        }
        rotations[16 + side] = store(upper);
        rotations[18 + side] = store(upper);
        rotations[20 + side] = store(fore);
    }
    (positions, rotations)
}

/// Frame `i` of a client at 60 Hz.
pub(crate) fn raw(body: &Body, i: u64) -> RawSkeleton {
    let mut raw = RawSkeleton::ZERO;
    raw.header = Header { sequence: i + 1, origin: Stamp(1_000_000_000 + i * 16_666_667), ..Header::ZERO };
    raw.session_nonce = 7;
    raw.operator_id = 1;
    raw.layout = SkeletonLayout::Smpl22 as u32;
    raw.joint_count = SMPL_JOINTS as u32;
    raw.flags = raw_flag::ROTATIONS;
    raw.positions[..SMPL_JOINTS].copy_from_slice(&body.0);
    raw.rotations[..SMPL_JOINTS].copy_from_slice(&body.1);
    raw.confidence[..SMPL_JOINTS].fill(1.0);
    raw
}

/// A person whose arms move a little.
pub(crate) fn standing(t: f64) -> Body {
    person([0.3 * t.sin(), 0.9, 0.2, 0.6, 0.1 * t.cos()], [0.3 * t.cos(), 0.9, 0.2, 0.6, 0.1])
}

/// Hinges for rotations that are identity in the T-pose.
pub(crate) fn t_pose_hinges() -> HingeCalibration {
    let mut hinges = HingeCalibration::ZERO;
    hinges.hinge = [[0.0, 0.0, -1.0], [0.0, 0.0, -1.0], [0.0, 0.0, 1.0], [0.0, 0.0, 1.0]];
    hinges.flags = calibration_flag::ALL;
    hinges
}

/// Returns the person of a frame, if it is accepted.
pub(crate) fn seen(state: &mut State, now: Stamp, raw: &RawSkeleton) -> Option<Skeleton> {
    tick(&Config::default(), state, now, Input { raw, stored: None }).skeleton
}

/// Feeds a frame on arrival. Returns the reason if the frame was dropped or an arm in it was not used.
pub(crate) fn feed(state: &mut State, raw: &RawSkeleton) -> Option<DropReason> {
    let now = raw.header.origin.plus_ns(1_000_000);
    let before = DropReason::ALL.map(|reason| state.dropped(reason));
    let out = tick(&Config::default(), state, now, Input { raw, stored: None });
    assert_ne!(out.skeleton.is_some(), out.drop.is_some());
    let refused = DropReason::ALL.into_iter().zip(before).find(|(reason, before)| state.dropped(*reason) > *before);
    refused.map(|(reason, _)| reason)
}

/// A state that has accepted `frames` frames of a moving person.
pub(crate) fn running(frames: u64) -> State {
    let mut state = State::default();
    for i in 0..frames {
        assert_eq!(feed(&mut state, &raw(&standing(i as f64 / 60.0), i)), None, "frame {i}");
    }
    state
}
