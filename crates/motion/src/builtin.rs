//! The built-in motions: a standing person whose arms, hands and head go through the poses of `builtin.toml`.

use crate::{Frame, Motion};
use messages::{SMPL_JOINTS, SMPL_PARENT, Smpl};
use nalgebra::{UnitQuaternion, Vector3};
use serde::Deserialize;
use skeleton::TORSO_LEAN_RAD;
use std::collections::HashMap;
use std::sync::LazyLock;

const RATE_HZ: f64 = 60.0;
/// Stature of the person of the built-in motions, m.
pub const STATURE_M: f64 = 1.75;
/// Shoulder to elbow, m (Winter, Biomechanics, 4th ed., fig. 4.1).
pub const UPPER_ARM_M: f64 = 0.186 * STATURE_M;
/// Elbow to wrist, m (Winter).
pub const FOREARM_M: f64 = 0.146 * STATURE_M;

/// Shoulder, elbow and wrist of the left and of the right arm.
pub const SMPL_ARMS: [[Smpl; 3]; 2] =
    [[Smpl::LeftShoulder, Smpl::LeftElbow, Smpl::LeftWrist], [Smpl::RightShoulder, Smpl::RightElbow, Smpl::RightWrist]];

/// An arm's pose, degrees: forward swing and lowering of the upper arm from the T-pose, its roll about itself,
/// flexion of the elbow, and pronation. Positive roll turns the forearm inwards when the arm hangs.
type ArmPose = [f64; 5];

/// Bend of a hand to its palm and to its thumb, degrees.
type HandPose = [f64; 2];

/// Turn of the head to the left, then its tilt forward, degrees.
type HeadPose = [f64; 2];

/// Name of the motion for `teleopctl calibrate`.
pub const CALIBRATION: &str = "builtin:calibration";
/// Name of the motion that picks up a box and puts it down.
pub const PICK_AND_PLACE: &str = "builtin:pick-and-place";

/// A pose of both arms, reached after `seconds`.
#[derive(Deserialize)]
struct Key {
    seconds: f64,
    /// Names of the poses of the left and of the right arm.
    arms: [String; 2],
    /// Bend of both hands.
    #[serde(default)]
    hand: HandPose,
    #[serde(default)]
    head: HeadPose,
    /// Closure of both hands.
    #[serde(default)]
    closure: f64,
}

/// The motions of `builtin.toml`, and the poses of an arm by their names.
#[derive(Deserialize)]
#[serde(rename_all = "kebab-case")]
struct Score {
    builtin: Vec<Key>,
    calibration: Vec<Key>,
    pick_and_place: Vec<Key>,
    arms: HashMap<String, ArmPose>,
}

static SCORE: LazyLock<Score> =
    LazyLock::new(|| toml::from_str(include_str!("builtin.toml")).unwrap_or_else(|error| panic!("{error}")));

/// Returns the built-in motion of this name: `builtin`, [`PICK_AND_PLACE`], or [`CALIBRATION`]. `builtin:` may be left out.
pub fn builtin_named(name: &str) -> Option<Motion> {
    let is = |whole: &str| name == whole || whole.strip_prefix("builtin:") == Some(name);
    match name {
        "builtin" => Some(builtin()),
        _ if is(CALIBRATION) => Some(played(CALIBRATION, &SCORE.calibration)),
        _ if is(PICK_AND_PLACE) => Some(played(PICK_AND_PLACE, &SCORE.pick_and_place)),
        _ => None,
    }
}

/// Returns the demo motion of a person of 1.75 m, 60 Hz: T-pose, wave, hands up, hands to the chest, crossed
/// arms, and back. The blends are minimum-jerk. The motion ends as it begins, so it can be repeated directly.
pub fn builtin() -> Motion {
    played("builtin", &SCORE.builtin)
}

/// Plays the keys one after the other.
fn played(name: &str, keys: &[Key]) -> Motion {
    let mut frames = Vec::new();
    for pair in keys.windows(2) {
        let [from, to] = pair else { continue };
        let count = (to.seconds * RATE_HZ).round() as usize;
        for i in 0..count {
            let t = i as f64 / count as f64;
            let s = t * t * t * (10.0 + t * (6.0 * t - 15.0));
            let arms = [0, 1].map(|side| blend(&SCORE.arms[&from.arms[side]], &SCORE.arms[&to.arms[side]], s));
            let hands = [blend(&from.hand, &to.hand, s); 2];
            let closure = [Some(blend(&[from.closure], &[to.closure], s)[0] as f32); 2];
            frames.push(Frame { closure, ..frame(&arms, &hands, &blend(&from.head, &to.head, s)) });
        }
    }
    let count = frames.len() as f64;
    for (i, frame) in frames.iter_mut().enumerate() {
        sway(frame, i as f64 / count * 5.0 * std::f64::consts::TAU);
    }
    Motion::generated(name, RATE_HZ, frames)
}

/// Returns the pose at the share `s` of the way.
fn blend<const N: usize>(from: &[f64; N], to: &[f64; N], s: f64) -> [f64; N] {
    std::array::from_fn(|j| from[j] + s * (to[j] - from[j]))
}

/// Returns the T-pose of this person, with nominal bone lengths and an upright torso frame.
pub(crate) fn t_pose() -> [[f32; 3]; SMPL_JOINTS] {
    frame(&[[0.0; 5]; 2], &[[0.0; 2]; 2], &[0.0; 2]).positions
}

/// Moves a person by a sway of 3 mm at this phase, rad. No real person stands perfectly still. With it, a pause differs
/// from a stuck tracker.
pub fn sway(frame: &mut Frame, phase: f64) {
    let (sin, cos) = phase.sin_cos();
    for position in &mut frame.positions {
        position[0] += (0.003 * sin) as f32;
        position[1] += (0.003 * cos) as f32;
    }
}

/// Returns a standing person with these arms, hands and head.
fn frame(arms: &[ArmPose; 2], hands: &[HandPose; 2], head: &HeadPose) -> Frame {
    let about = |axis, angle: f64| UnitQuaternion::from_axis_angle(&axis, angle.to_radians());
    let (x, y, z) = (Vector3::x_axis(), Vector3::y_axis(), Vector3::z_axis());
    let limbs = [0, 1].map(|side| {
        let [swing, lower, roll, flex, twist] = arms[side];
        let [to_palm, to_thumb] = hands[side];
        let upper = about(z, -swing) * about(x, -lower) * about(y, roll);
        let fore = upper * about(z, -flex);
        // In the T-pose the palm looks down and the thumb forward.
        [upper, fore, fore * about(y, -twist) * about(x, -to_palm) * about(z, -to_thumb)]
    });
    let mut out = with_limbs(&Frame { positions: standing(), ..Frame::ZERO }, &limbs);
    let [pan, tilt] = *head;
    let q = (about(z, pan) * about(y, tilt)).cast::<f32>();
    out.rotations[Smpl::Head as usize] = [q.i, q.j, q.k, q.w];
    out
}

/// Returns `frame`, of an upright person who faces x, with its arms replaced by these rotations of upper arm,
/// forearm and hand. Each is that of a left arm, or of a right one mirrored to the left. Bones keep their
/// lengths.
pub fn with_limbs(frame: &Frame, arms: &[[UnitQuaternion<f64>; 3]; 2]) -> Frame {
    let mut out = *frame;
    for (side, (rotations, joints)) in arms.iter().zip(SMPL_ARMS).enumerate() {
        for (joint, rotation) in joints.into_iter().zip(rotations) {
            // The right arm is the mirror image of a left one: (x, y, z, w) -> (-x, y, -z, w).
            let q = rotation.cast::<f32>();
            out.rotations[joint as usize] = if side == 0 { [q.i, q.j, q.k, q.w] } else { [-q.i, q.j, -q.k, q.w] };
        }
        for (joint, rotation, length) in
            [(joints[1], &rotations[0], UPPER_ARM_M), (joints[2], &rotations[1], FOREARM_M)]
        {
            let mut bone = rotation * Vector3::y() * length;
            if side == 1 {
                bone.y = -bone.y;
            }
            let parent = Vector3::from(out.positions[SMPL_PARENT[joint as usize]]);
            out.positions[joint as usize] = (parent + bone.cast::<f32>()).into();
        }
    }
    out
}

/// Joints of a standing person without arms, m. Segment lengths are after Winter, Biomechanics, 4th ed., fig. 4.1.
fn standing() -> [[f32; 3]; SMPL_JOINTS] {
    let h = STATURE_M;
    let shoulders_z = 0.818 * h;
    let hips_z = 0.53 * h;
    // Shoulders lean back as in the T-pose that the torso frame calls upright.
    let shoulders_x = -(shoulders_z - hips_z) * TORSO_LEAN_RAD.tan();
    let mut out = [[0.0; 3]; SMPL_JOINTS];
    let mut place = |joint: Smpl, x: f64, y: f64, z: f64| out[joint as usize] = [x as f32, y as f32, z as f32];
    place(Smpl::Pelvis, 0.0, 0.0, hips_z + 0.03 * h);
    place(Smpl::Spine1, shoulders_x * 0.3, 0.0, hips_z + 0.08 * h);
    place(Smpl::Spine2, shoulders_x * 0.5, 0.0, hips_z + 0.14 * h);
    place(Smpl::Spine3, shoulders_x * 0.6, 0.0, hips_z + 0.2 * h);
    place(Smpl::Neck, shoulders_x, 0.0, 0.84 * h);
    place(Smpl::Head, 0.0, 0.0, 0.91 * h);
    let left = [Smpl::LeftHip, Smpl::LeftKnee, Smpl::LeftAnkle, Smpl::LeftFoot, Smpl::LeftCollar, Smpl::LeftShoulder];
    let right =
        [Smpl::RightHip, Smpl::RightKnee, Smpl::RightAnkle, Smpl::RightFoot, Smpl::RightCollar, Smpl::RightShoulder];
    for (side, joints) in [(1.0, left), (-1.0, right)] {
        let [hip, knee, ankle, foot, collar, shoulder] = joints;
        place(hip, 0.0, side * 0.055 * h, hips_z);
        place(knee, 0.01 * h, side * 0.055 * h, 0.285 * h);
        place(ankle, 0.0, side * 0.055 * h, 0.039 * h);
        place(foot, 0.08 * h, side * 0.065 * h, 0.015 * h);
        place(collar, shoulders_x * 0.7, side * 0.03 * h, 0.8 * h);
        place(shoulder, shoulders_x, side * 0.105 * h, shoulders_z);
    }
    out
}
