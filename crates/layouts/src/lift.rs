//! Gives a person the directions that a [`Lifter`] found in the image. Lengths stay as the frame has them, or typical ones.
//!
//! ```text
//! shoulders = hips + T u,  shoulder = shoulders +- w T a / 2,  elbow = shoulder + r T R d_0,  wrist = elbow + s T R d_2
//! ```
//!
//! R = (a, u, a x u) are the trunk's axes, T its length, w, r and s lengths over the trunk's.

use crate::axes::{Axes, Direction};
use crate::lifter::{ImagePoints, LENGTHS, Lifted, Lifter, TYPICAL};
use crate::neutral::{COLLAR, UP_THE_TRUNK};
use messages::{RawSkeleton, SMPL_JOINTS, Smpl};
use nalgebra::{Matrix3, Vector3};

/// Axes of a camera before the person.
const FACING: Axes = Axes::from_directions([Direction::Left, Direction::Down, Direction::Back]);
/// A trunk of unknown length, m: that of the neutral skeleton.
const TRUNK_M: f64 = 0.5;
/// Breadths of shoulders and hips over the trunk's length, of the mesh that the training people have. No motion of a robot
/// depends on them.
const SHOULDERS: f64 = 0.75;
const HIPS: f64 = 0.46;
/// Lengths of bones over the trunk's that can be true: see `lengths`.
const BONE_PER_TRUNK: [f64; 2] = [0.2, 0.9];
/// Expected angle at which an arm is not used at all, rad: a right angle is a guess. Half of it is 45 degrees, where
/// `confidence_min` holds the arm. Assumption.
const GUESS_RAD: f64 = std::f64::consts::FRAC_PI_2;

impl Lifter {
    /// Lifts the image, and gives the frame of SMPL-22 the directions and the confidence of its arms. Returns false, and
    /// leaves the frame, without shoulders and hips in the image. `lengths` are those of the session. Never allocates or
    /// panics, whatever the bits.
    pub fn apply(&self, image: &ImagePoints, lengths: Option<[f64; LENGTHS]>, frame: &mut RawSkeleton) -> bool {
        let lifted = self.lift(image, lengths);
        let placed = lifted.and_then(|lifted| Some((lifted, ours(lifted.trunk()?))));
        if let Some((lifted, axes)) = placed {
            place(&lifted, &axes, frame);
        }
        placed.is_some()
    }
}

/// Turns the camera's axes to ours.
fn ours(axes: Matrix3<f64>) -> Matrix3<f64> {
    Matrix3::from_columns(&[0, 1, 2].map(|i| Vector3::from(FACING.polar(axes.column(i).into_owned().into()))))
}

fn place(lifted: &Lifted, axes: &Matrix3<f64>, frame: &mut RawSkeleton) {
    let at = |joint: Smpl| {
        let place = Vector3::from(frame.positions[joint as usize]).map(f64::from);
        (frame.confidence[joint as usize] > 0.0 && place.iter().all(|x| x.is_finite())).then_some(place)
    };
    let middle = |a: Smpl, b: Smpl| Some((at(a)? + at(b)?) / 2.0);
    let [hips, shoulders] =
        [[Smpl::LeftHip, Smpl::RightHip], [Smpl::LeftShoulder, Smpl::RightShoulder]].map(|[a, b]| middle(a, b));
    let is_flat = hips.is_none() || shoulders.is_none();
    let hips = hips.unwrap_or_default();
    let trunk_m = shoulders.map_or(TRUNK_M, |shoulders| (shoulders - hips).norm()).max(1e-3);
    let share = |from: Smpl, to: Smpl, typical: f64| {
        let own = at(from).zip(at(to)).map(|(from, to)| (to - from).norm() / trunk_m);
        own.filter(|own| (BONE_PER_TRUNK[0]..=BONE_PER_TRUNK[1]).contains(own)).unwrap_or(typical)
    };
    let [across, up] = [axes.column(0).into_owned(), axes.column(1).into_owned()];
    let shoulders = hips + up * trunk_m;
    let mut set = [None; SMPL_JOINTS];
    let sides = [
        (1.0, [Smpl::LeftHip, Smpl::LeftShoulder, Smpl::LeftElbow, Smpl::LeftWrist], Smpl::LeftCollar, 0),
        (-1.0, [Smpl::RightHip, Smpl::RightShoulder, Smpl::RightElbow, Smpl::RightWrist], Smpl::RightCollar, 1),
    ];
    let mut confidence = [None; SMPL_JOINTS];
    for (side, [hip, shoulder, elbow, wrist], collar, arm) in sides {
        let shoulder_at = shoulders + across * (side * SHOULDERS * trunk_m / 2.0);
        let elbow_at = shoulder_at + axes * lifted.directions[arm] * (share(shoulder, elbow, TYPICAL[0]) * trunk_m);
        let wrist_at = elbow_at + axes * lifted.directions[2 + arm] * (share(elbow, wrist, TYPICAL[1]) * trunk_m);
        set[hip as usize] = Some(hips + across * (side * HIPS * trunk_m / 2.0));
        set[shoulder as usize] = Some(shoulder_at);
        set[collar as usize] = Some(shoulders + (shoulder_at - shoulders) * COLLAR);
        set[elbow as usize] = Some(elbow_at);
        set[wrist as usize] = Some(wrist_at);
        let sure = |direction: usize| (1.0 - lifted.expected_rad(direction) / GUESS_RAD).clamp(0.0, 1.0) as f32;
        confidence[elbow as usize] = Some(sure(arm));
        confidence[wrist as usize] = Some(sure(arm).min(sure(2 + arm)));
        if is_flat {
            (confidence[hip as usize], confidence[shoulder as usize]) = (Some(1.0), Some(1.0));
        }
    }
    for (joint, share) in UP_THE_TRUNK {
        set[joint] = Some(hips + (shoulders - hips) * share);
    }
    if is_flat {
        set[Smpl::Head as usize] = Some(shoulders + up * (0.4 * trunk_m));
    }
    for joint in 0..SMPL_JOINTS {
        if let Some(place) = set[joint] {
            frame.positions[joint] = place.map(|x| x as f32).into();
            let known = if is_flat { 1.0 } else { frame.confidence[joint] };
            frame.confidence[joint] = confidence[joint].unwrap_or(known);
        }
    }
}
