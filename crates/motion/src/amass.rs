//! AMASS: SMPL-H and SMPL-X body poses in .npz, z up. Forward kinematics over this crate's own standing person
//! gives joint positions from the rotations, because body models may not be redistributed. Limb rotations are the
//! source's, lengths are nominal.

use crate::bvh::{Pose, RigFrame};
use crate::error::ArrayError;
use crate::npy::{self, Array, Npz};
use crate::{FRAMES_MAX, LoadOptions, builtin};
use messages::{SMPL_JOINTS, SMPL_PARENT};
use nalgebra::{UnitQuaternion, Vector3};
use std::io::{Read, Seek};

/// Columns of `poses` that move the 22 joints of the body. Each joint has an axis-angle vector.
const BODY_COLUMNS: usize = 3 * SMPL_JOINTS;
/// Widths of `poses` that begin with these columns: SMPL-22 alone, SMPL, SMPL-H, SMPL-X.
const POSES_WIDTHS: [usize; 4] = [BODY_COLUMNS, 72, 156, 165];
/// Keys of the frame rate: SMPL-H, SMPL-X, and what converters write.
const RATE_KEYS: [&str; 5] = ["mocap_framerate", "mocap_frame_rate", "fps", "frame_rate", "framerate"];
/// Largest angle, rad, and largest coordinate, m.
const NUMBER_MAX: f64 = 1e4;

/// A sequence in its own frame (z up, m).
pub(crate) struct Sequence {
    pub(crate) frame_rate_hz: f64,
    pub(crate) frames: Vec<RigFrame>,
    pub(crate) warnings: Vec<String>,
}

/// Reads only the required keys. `gender`, `betas` and other keys may hold anything.
pub(crate) fn read(source: impl Read + Seek, options: &LoadOptions) -> Result<Sequence, ArrayError> {
    let mut npz = Npz::open(source)?;
    let mut warnings = Vec::new();
    let poses = body_poses(&mut npz)?;
    let count = poses.len() / BODY_COLUMNS;
    let stored = RATE_KEYS.iter().find_map(|key| Some(npz.read(key).transpose()?.map(|array| (key, array))));
    let rate = match (options.frame_rate_hz, stored.transpose()?) {
        (Some(rate), _) => rate,
        (None, Some((_, Array { values, .. }))) if values.len() == 1 => values[0],
        (None, Some((key, array))) => {
            let error = ArrayError::Shape { found: array.shape, expected: "() one number" };
            return Err(error.in_key(key));
        }
        (None, None) => {
            let missing = "mocap_framerate, mocap_frame_rate or fps (--frame-rate HZ replaces it)";
            return Err(ArrayError::MissingKeys { missing, found: npz.keys() });
        }
    };
    if !(crate::FRAME_RATE_HZ[0]..=crate::FRAME_RATE_HZ[1]).contains(&rate) {
        let [low, high] = crate::FRAME_RATE_HZ;
        return Err(ArrayError::FrameRate { value: rate, low, high });
    }
    let trans = match npz.read("trans")? {
        Some(trans) => matrix(trans, &[3], "(N, 3)").map_err(|error| error.in_key("trans"))?,
        None => {
            warnings.push("no trans: the person does not walk".to_owned());
            vec![0.0; 3 * count]
        }
    };
    if trans.len() != 3 * count {
        let error = ArrayError::Shape { found: vec![trans.len() / 3, 3], expected: "(N, 3), N as in the poses" };
        return Err(error.in_key("trans"));
    }
    warnings.push("no body model: uses the limb lengths of a 1.75 m person".to_owned());
    let rest = rest_bones();
    let frames = poses.chunks_exact(BODY_COLUMNS).zip(trans.chunks_exact(3));
    let frames = frames.map(|(pose, trans)| forward(pose, Vector3::from_column_slice(trans), &rest)).collect();
    Ok(Sequence { frame_rate_hz: rate, frames, warnings })
}

/// Returns (N, 66) axis-angle vectors: `root_orient` and `pose_body` if they exist, else the first columns of
/// `poses`.
fn body_poses<R: Read + Seek>(npz: &mut Npz<R>) -> Result<Vec<f64>, ArrayError> {
    let body = BODY_COLUMNS - 3;
    if let (Some(root), Some(pose)) = (npz.read("root_orient")?, npz.read("pose_body")?) {
        let root = matrix(root, &[3], "(N, 3)").map_err(|error| error.in_key("root_orient"))?;
        let pose = matrix(pose, &[body], "(N, 63)").map_err(|error| error.in_key("pose_body"))?;
        if root.len() / 3 != pose.len() / body {
            let error = ArrayError::Shape { found: vec![root.len() / 3, 3], expected: "(N, 3), N as in pose_body" };
            return Err(error.in_key("root_orient"));
        }
        let rows = root.chunks_exact(3).zip(pose.chunks_exact(body));
        let mut both = Vec::with_capacity(root.len() + pose.len());
        rows.for_each(|(root, body)| both.extend(root.iter().chain(body)));
        return Ok(both);
    }
    let Some(poses) = npz.read("poses")? else {
        let missing = "poses, or root_orient and pose_body";
        return Err(ArrayError::MissingKeys { missing, found: npz.keys() });
    };
    let expected = "(N, 156) SMPL-H, (N, 165) SMPL-X, (N, 72) SMPL or (N, 66)";
    let width = poses.squeezed().last().copied().unwrap_or(1);
    let rows = matrix(poses, &POSES_WIDTHS, expected).map_err(|error| error.in_key("poses"))?;
    let mut body = Vec::with_capacity(rows.len() / width * BODY_COLUMNS);
    rows.chunks_exact(width).for_each(|row| body.extend_from_slice(&row[..BODY_COLUMNS]));
    Ok(body)
}

/// Returns the values of an (N, width) array. The width must be one of `widths`, N at least 1, and all values in
/// bounds.
fn matrix(array: Array, widths: &[usize], expected: &'static str) -> Result<Vec<f64>, ArrayError> {
    let lengths = array.squeezed();
    let (frames, width) = match *lengths.as_slice() {
        [frames, width] => (frames, width),
        // A single frame loses its N, because dimensions of length one are removed.
        [width] if array.shape.len() > 1 => (1, width),
        _ => (0, 0),
    };
    if !widths.contains(&width) {
        return Err(ArrayError::Shape { found: array.shape, expected });
    }
    if frames == 0 {
        return Err(ArrayError::Empty { shape: array.shape });
    }
    if frames > FRAMES_MAX {
        return Err(ArrayError::TooManyFrames { frames, bound: FRAMES_MAX });
    }
    npy::check_numbers(&array.values, width, NUMBER_MAX)?;
    Ok(array.values)
}

/// Bones of the T-pose from parent to joint, m, in the axes of SMPL's body: x left, y up, z forward.
fn rest_bones() -> [Vector3<f64>; SMPL_JOINTS] {
    let rest = builtin::t_pose().map(|[x, y, z]| Vector3::new(f64::from(y), f64::from(z), f64::from(x)));
    std::array::from_fn(|j| rest[j] - rest[SMPL_PARENT[j]])
}

/// Computes global poses: R_j = R_parent exp(pose_j), p_j = p_parent + R_parent bone_j. The pelvis is at `trans`.
fn forward(pose: &[f64], trans: Vector3<f64>, rest: &[Vector3<f64>; SMPL_JOINTS]) -> RigFrame {
    let mut out = [Pose { position: trans, rotation: UnitQuaternion::identity() }; SMPL_JOINTS];
    for (j, turn) in pose.chunks_exact(3).enumerate().take(SMPL_JOINTS) {
        let local = UnitQuaternion::from_scaled_axis(Vector3::from_column_slice(turn));
        let parent = out[SMPL_PARENT[j]];
        out[j] = if j == SMPL_PARENT[j] {
            Pose { position: trans, rotation: local }
        } else {
            Pose { position: parent.position + parent.rotation * rest[j], rotation: parent.rotation * local }
        };
    }
    out
}
