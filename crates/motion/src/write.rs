//! Writes BVH: SMPL-22 with the names of LAFAN1, six channels on every joint, centimetres, Y up, +Z forward.

use crate::bvh::is_rest;
use crate::{Frame, Motion, MotionError};
use messages::{SMPL_JOINTS, SMPL_PARENT};
use nalgebra::{Matrix3, Quaternion, Rotation3, UnitQuaternion, Vector3};
use std::fmt::Write;
use std::path::Path;

/// Names of the joints of SMPL-22.
#[rustfmt::skip]
const NAMES: [&str; SMPL_JOINTS] = [
    "Hips", "LeftUpLeg", "RightUpLeg", "Spine", "LeftLeg", "RightLeg", "Spine1", "LeftFoot", "RightFoot", "Spine2", "LeftToe",
    "RightToe", "Neck", "LeftShoulder", "RightShoulder", "Head", "LeftArm", "RightArm", "LeftForeArm", "RightForeArm", "LeftHand",
    "RightHand",
];
const CHANNELS: &str = "CHANNELS 6 Xposition Yposition Zposition Zrotation Yrotation Xrotation";

/// Saves a motion as BVH.
pub fn save_bvh(motion: &Motion, path: &Path) -> Result<(), MotionError> {
    let io = |source| MotionError::Io { file: path.display().to_string(), source };
    std::fs::write(path, write_bvh(motion)).map_err(io)
}

/// Returns the motion as BVH text. [`crate::parse_bvh`] can read it. Frame 0 of the file is `first`. If the
/// motion has none and begins like a rest pose, its first frame is written twice, because readers drop one.
pub fn write_bvh(motion: &Motion) -> String {
    let begin = motion.frames.first().copied().unwrap_or(Frame::ZERO);
    let before = motion.first.or_else(|| is_rest(&motion.frames).then_some(begin));
    let first = before.unwrap_or(begin);
    let mut text = String::from("HIERARCHY\n");
    let mut order = Vec::with_capacity(SMPL_JOINTS);
    write_joint(&mut text, &mut order, &locals(&first), 0, 0);
    let frames = motion.frames.len() + usize::from(before.is_some());
    // Writing to a string cannot fail.
    let _ = write!(text, "MOTION\nFrames: {frames}\nFrame Time: {:.9}\n", 1.0 / motion.frame_rate_hz);
    for frame in before.iter().chain(&motion.frames) {
        let locals = locals(frame);
        for &joint in &order {
            let (position, rotation) = &locals[joint];
            let (x, y, z) = rotation.euler_angles();
            let [z, y, x] = [z, y, x].map(f64::to_degrees);
            let _ = write!(text, "{:.6} {:.6} {:.6} {z:.6} {y:.6} {x:.6} ", position.x, position.y, position.z);
        }
        text.push('\n');
    }
    text
}

fn write_joint(
    text: &mut String,
    order: &mut Vec<usize>,
    locals: &[(Vector3<f64>, UnitQuaternion<f64>); SMPL_JOINTS],
    joint: usize,
    depth: usize,
) {
    order.push(joint);
    let pad = "  ".repeat(depth);
    let kind = if depth == 0 { "ROOT" } else { "JOINT" };
    let (p, name) = (locals[joint].0, NAMES[joint]);
    let _ = write!(
        text,
        "{pad}{kind} {name}\n{pad}{{\n{pad}  OFFSET {:.6} {:.6} {:.6}\n{pad}  {CHANNELS}\n",
        p.x, p.y, p.z
    );
    let children: Vec<usize> = (1..SMPL_JOINTS).filter(|&child| SMPL_PARENT[child] == joint).collect();
    for &child in &children {
        write_joint(text, order, locals, child, depth + 1);
    }
    if children.is_empty() {
        let _ = write!(text, "{pad}  End Site\n{pad}  {{\n{pad}    OFFSET 0 0 0\n{pad}  }}\n");
    }
    let _ = writeln!(text, "{pad}}}");
}

/// Returns positions (cm) and rotations relative to the parent, in the file's frame.
fn locals(frame: &Frame) -> [(Vector3<f64>, UnitQuaternion<f64>); SMPL_JOINTS] {
    // Axes: x forward, y left, z up -> X left, Y up, Z forward.
    let matrix = Matrix3::new(0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0);
    let file = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(matrix));
    let position = |joint: usize| file * Vector3::from(frame.positions[joint]).cast::<f64>() * 100.0;
    let rotation = |joint: usize| {
        let [x, y, z, w] = frame.rotations[joint].map(f64::from);
        file * UnitQuaternion::new_normalize(Quaternion::new(w, x, y, z))
    };
    std::array::from_fn(|joint| {
        let parent = SMPL_PARENT[joint];
        if joint == parent {
            return (position(joint), rotation(joint));
        }
        let back = rotation(parent).inverse();
        (back * (position(joint) - position(parent)), back * rotation(joint))
    })
}
