//! The built-in motions. They are procedural, made for this project, and slow enough for a robot arm of 2 rad/s.

use crate::{Frame, Guesses, Motion};
use messages::{SMPL_JOINTS, SMPL_PARENT, Smpl};
use nalgebra::{UnitQuaternion, Vector3};
use skeleton::TORSO_LEAN_RAD;

const RATE_HZ: f64 = 60.0;
const STATURE_M: f64 = 1.75;

/// An arm's pose, degrees: forward swing and lowering of the upper arm from the T-pose, its roll about itself,
/// flexion of the elbow, and pronation. Positive roll turns the forearm inwards when the arm hangs.
type ArmPose = [f64; 5];

const T_POSE: ArmPose = [0.0, 0.0, 0.0, 0.0, 0.0];
const REST: ArmPose = [0.0, 72.0, 0.0, 15.0, 0.0];
const WAVE: ArmPose = [12.0, 0.0, -85.0, 75.0, 0.0];
const WAVE_OUT: ArmPose = [12.0, 0.0, -85.0, 50.0, 0.0];
const WAVE_IN: ArmPose = [12.0, 0.0, -85.0, 100.0, 0.0];
const HANDS_UP: ArmPose = [5.0, -25.0, -88.0, 55.0, 0.0];
const CHEST: ArmPose = [15.0, 58.0, 42.0, 108.0, 0.0];
const CROSSED: ArmPose = [48.0, 42.0, 40.0, 88.0, 20.0];
const ARMS_UP: ArmPose = [0.0, -60.0, 0.0, 0.0, 0.0];
const ARMS_DOWN: ArmPose = [0.0, 60.0, 0.0, 0.0, 0.0];
const ELBOWS_BENT: ArmPose = [0.0, 0.0, 0.0, 95.0, 0.0];

/// Name of the motion for `teleopctl calibrate`.
pub const CALIBRATION: &str = "builtin:calibration";

/// A pose of both arms, left and right, reached after `seconds`. The fastest blend stays below 1.9 rad/s in each angle,
/// because a minimum-jerk blend peaks at 1.875 times its mean speed.
struct Key {
    seconds: f64,
    left: ArmPose,
    right: ArmPose,
}

const fn key(seconds: f64, left: ArmPose, right: ArmPose) -> Key {
    Key { seconds, left, right }
}

const KEYS: [Key; 19] = [
    key(0.0, T_POSE, T_POSE),
    key(0.8, T_POSE, T_POSE),
    key(1.8, REST, REST),
    key(0.4, REST, REST),
    key(2.0, REST, WAVE),
    key(0.6, REST, WAVE_OUT),
    key(0.9, REST, WAVE_IN),
    key(0.9, REST, WAVE_OUT),
    key(0.9, REST, WAVE_IN),
    key(0.6, REST, WAVE),
    key(2.2, HANDS_UP, HANDS_UP),
    key(0.6, HANDS_UP, HANDS_UP),
    key(2.8, CHEST, CHEST),
    key(0.8, CHEST, CHEST),
    key(1.6, CROSSED, CROSSED),
    key(0.8, CROSSED, CROSSED),
    key(1.8, REST, REST),
    key(1.8, T_POSE, T_POSE),
    key(0.6, T_POSE, T_POSE),
];

/// A T-pose held for 4 s. Then the arms move up and down, and the elbows bend and stretch.
const CALIBRATION_KEYS: [Key; 11] = [
    key(0.0, T_POSE, T_POSE),
    key(4.0, T_POSE, T_POSE),
    key(1.2, ARMS_UP, ARMS_UP),
    key(2.2, ARMS_DOWN, ARMS_DOWN),
    key(1.2, T_POSE, T_POSE),
    key(1.8, ELBOWS_BENT, ELBOWS_BENT),
    key(1.8, T_POSE, T_POSE),
    key(1.8, ELBOWS_BENT, ELBOWS_BENT),
    key(1.8, T_POSE, T_POSE),
    key(1.8, ELBOWS_BENT, ELBOWS_BENT),
    key(1.8, T_POSE, T_POSE),
];

/// Returns the built-in motion of this name: `builtin`, or [`CALIBRATION`].
pub fn builtin_named(name: &str) -> Option<Motion> {
    match name {
        "builtin" => Some(builtin()),
        CALIBRATION => Some(played(CALIBRATION, &CALIBRATION_KEYS)),
        _ => None,
    }
}

/// Returns the demo motion of a person of 1.75 m, 60 Hz: T-pose, wave, hands up, hands to the chest, crossed
/// arms, and back. The blends are minimum-jerk. The motion ends as it begins, so it can be repeated directly.
pub fn builtin() -> Motion {
    played("builtin", &KEYS)
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
            let blend = |a: &ArmPose, b: &ArmPose| std::array::from_fn(|j| a[j] + s * (b[j] - a[j]));
            frames.push(frame(&blend(&from.left, &to.left), &blend(&from.right, &to.right)));
        }
    }
    sway(&mut frames);
    let guesses = Guesses { scale_m_per_unit: 1.0, unit: "m", stature_m: STATURE_M, up: "+Z", warnings: Vec::new() };
    Motion { name: name.to_owned(), frame_rate_hz: RATE_HZ, frames, first: None, has_rotations: true, guesses }
}

/// Returns the T-pose of this person, with nominal bone lengths and an upright torso frame.
pub(crate) fn t_pose() -> [[f32; 3]; SMPL_JOINTS] {
    frame(&T_POSE, &T_POSE).positions
}

/// Adds a sway of 3 mm, five times in the motion. No real person stands perfectly still. With it, a pause differs
/// from a stuck tracker.
fn sway(frames: &mut [Frame]) {
    let count = frames.len() as f64;
    for (i, frame) in frames.iter_mut().enumerate() {
        let (sin, cos) = (i as f64 / count * 5.0 * std::f64::consts::TAU).sin_cos();
        for position in &mut frame.positions {
            position[0] += (0.003 * sin) as f32;
            position[1] += (0.003 * cos) as f32;
        }
    }
}

/// Returns a standing person with these arms.
fn frame(left: &ArmPose, right: &ArmPose) -> Frame {
    let mut out = Frame { positions: standing(), rotations: [[0.0, 0.0, 0.0, 1.0]; SMPL_JOINTS] };
    let joints = [
        [Smpl::LeftShoulder, Smpl::LeftElbow, Smpl::LeftWrist],
        [Smpl::RightShoulder, Smpl::RightElbow, Smpl::RightWrist],
    ];
    for (side, (pose, [shoulder, elbow, wrist])) in [left, right].into_iter().zip(joints).enumerate() {
        let [swing, lower, roll, flex, twist] = pose.map(f64::to_radians);
        let about = |axis, angle| UnitQuaternion::from_axis_angle(&axis, angle);
        let (x, y, z) = (Vector3::x_axis(), Vector3::y_axis(), Vector3::z_axis());
        let upper = about(z, -swing) * about(x, -lower) * about(y, roll);
        let fore = upper * about(z, -flex);
        let rotations = [(shoulder, upper), (elbow, fore), (wrist, fore * about(y, -twist))];
        for (joint, rotation) in rotations {
            // The right arm is the mirror image of a left one: (x, y, z, w) -> (-x, y, -z, w).
            let q = rotation.cast::<f32>();
            let mirrored = if side == 0 { [q.i, q.j, q.k, q.w] } else { [-q.i, q.j, -q.k, q.w] };
            out.rotations[joint as usize] = mirrored;
        }
        // Upper arm 0.186 and forearm 0.146 of the stature (Winter, fig. 4.1).
        for (joint, rotation, length) in [(elbow, upper, 0.186), (wrist, fore, 0.146)] {
            let mut bone = rotation * Vector3::y() * (length * STATURE_M);
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
    let mut put = |joint: Smpl, x: f64, y: f64, z: f64| out[joint as usize] = [x as f32, y as f32, z as f32];
    put(Smpl::Pelvis, 0.0, 0.0, hips_z + 0.03 * h);
    put(Smpl::Spine1, shoulders_x * 0.3, 0.0, hips_z + 0.08 * h);
    put(Smpl::Spine2, shoulders_x * 0.5, 0.0, hips_z + 0.14 * h);
    put(Smpl::Spine3, shoulders_x * 0.6, 0.0, hips_z + 0.2 * h);
    put(Smpl::Neck, shoulders_x, 0.0, 0.84 * h);
    put(Smpl::Head, 0.0, 0.0, 0.91 * h);
    let left = [Smpl::LeftHip, Smpl::LeftKnee, Smpl::LeftAnkle, Smpl::LeftFoot, Smpl::LeftCollar, Smpl::LeftShoulder];
    let right =
        [Smpl::RightHip, Smpl::RightKnee, Smpl::RightAnkle, Smpl::RightFoot, Smpl::RightCollar, Smpl::RightShoulder];
    for (side, joints) in [(1.0, left), (-1.0, right)] {
        let [hip, knee, ankle, foot, collar, shoulder] = joints;
        put(hip, 0.0, side * 0.055 * h, hips_z);
        put(knee, 0.01 * h, side * 0.055 * h, 0.285 * h);
        put(ankle, 0.0, side * 0.055 * h, 0.039 * h);
        put(foot, 0.08 * h, side * 0.065 * h, 0.015 * h);
        put(collar, shoulders_x * 0.7, side * 0.03 * h, 0.8 * h);
        put(shoulder, shoulders_x, side * 0.105 * h, shoulders_z);
    }
    out
}
