//! Measurement of a person in a T-pose that is held still.

use crate::geometry::vector;
use crate::limbs::{ARMS, torso_rotation_leaning};
use crate::reference::{Calibration, LEAN_MAX_RAD};
use messages::{LIMBS, SMPL_JOINTS, Skeleton, Smpl, Stamp, skeleton_flag};
use nalgebra::Vector3;

/// Smallest cosine between a bone of the arm and the line through the shoulders: 25 degrees. Assumption: people
/// who are asked to hold their arms out come so close without a mirror.
const ALONG_MIN: f64 = 0.906;
/// Largest motion of a wrist or a shoulder in a pose that is held still, m: three times a person's sway and a
/// camera's noise of 10 mm.
const STILL_M: f64 = 0.05;

/// Comparison of a frame with a T-pose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Pose {
    /// A joint of the trunk or the arms is not visible.
    Unseen,
    /// The trunk leans by more than 20 degrees.
    Leaning,
    /// An arm is not straight out to its side.
    ArmsNotOut,
    /// A T-pose, held for this many nanoseconds.
    Held(u64),
}

/// Detects a held T-pose and averages its measurements.
#[derive(Clone, Copy, Debug, Default)]
pub struct TPose {
    begin: Option<(Stamp, [Vector3<f64>; 4])>,
    frames: f64,
    lengths_m: [f64; LIMBS],
    lean_rad: f64,
}

impl TPose {
    /// Takes a frame in a world whose z points up. A frame that is no T-pose, or has moved since the pose began,
    /// restarts the measurement.
    pub fn add(&mut self, skeleton: &Skeleton) -> Pose {
        let (pose, points) = judge(skeleton);
        let (Some((points, lean_rad, lengths_m)), Pose::Held(_)) = (points, pose) else {
            *self = Self::default();
            return pose;
        };
        let origin = skeleton.header.origin;
        let still = |was: &[Vector3<f64>; 4]| was.iter().zip(&points).all(|(was, is)| (is - was).norm() <= STILL_M);
        let begin = match self.begin {
            Some((since, was)) if still(&was) && origin >= since => since,
            _ => {
                *self = Self { begin: Some((origin, points)), ..Self::default() };
                origin
            }
        };
        self.frames += 1.0;
        self.lean_rad += lean_rad;
        for (sum, length) in self.lengths_m.iter_mut().zip(lengths_m) {
            *sum += length;
        }
        Pose::Held(origin.since(begin))
    }

    /// Returns mean lengths and lean of the held pose. A T-pose does not show hinges.
    pub fn measured(&self) -> Option<Calibration> {
        self.begin.map(|_| Calibration {
            lengths_m: self.lengths_m.map(|sum| sum / self.frames),
            torso_lean_rad: self.lean_rad / self.frames,
            ..Calibration::NONE
        })
    }
}

type Seen = ([Vector3<f64>; 4], f64, [f64; LIMBS]);

/// Judges the pose. For a T-pose it also returns shoulders and wrists, the lean and the lengths.
fn judge(skeleton: &Skeleton) -> (Pose, Option<Seen>) {
    if skeleton.flags & skeleton_flag::ALL != skeleton_flag::ALL {
        return (Pose::Unseen, None);
    }
    let at = |joint: usize| vector(skeleton.positions[joint]);
    let Some(lean_rad) = lean(&skeleton.positions) else { return (Pose::Unseen, None) };
    if lean_rad.abs() > LEAN_MAX_RAD {
        return (Pose::Leaning, None);
    }
    let across = at(Smpl::LeftShoulder as usize) - at(Smpl::RightShoulder as usize);
    let (mut points, mut lengths_m, mut out) = ([Vector3::zeros(); 4], [0.0; LIMBS], true);
    for (side, [shoulder, elbow, wrist]) in ARMS.into_iter().enumerate() {
        let outwards = if side == 0 { across } else { -across };
        for (limb, [from, to]) in [[shoulder, elbow], [elbow, wrist]].into_iter().enumerate() {
            let bone = at(to) - at(from);
            lengths_m[2 * side + limb] = bone.norm();
            out &= bone.dot(&outwards) >= ALONG_MIN * bone.norm() * outwards.norm();
        }
        (points[2 * side], points[2 * side + 1]) = (at(shoulder), at(wrist));
    }
    if out { (Pose::Held(0), Some((points, lean_rad, lengths_m))) } else { (Pose::ArmsNotOut, None) }
}

/// Lean of the line from the hips to the shoulders against the vertical, rad, positive to the back. `None` if
/// either has no direction or the person does not stand.
fn lean(positions: &[[f32; 3]; SMPL_JOINTS]) -> Option<f64> {
    // Columns: front, left, and from the hips to the shoulders.
    let torso = torso_rotation_leaning(positions, 0.0)?;
    let (front_up, spine_up) = (torso[(2, 0)], torso[(2, 2)]);
    (spine_up > 0.0).then(|| front_up.atan2(spine_up))
}
