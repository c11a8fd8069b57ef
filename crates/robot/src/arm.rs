//! An arm for the retargeting: five joints turn its two limbs.

use crate::error::RobotError;
use crate::kinematics::Frames;
use crate::limits::JointLimits;
use crate::model::Model;
use crate::pose::rotation;
use messages::{ARM_JOINTS, JOINTS_MAX};
use nalgebra::{Matrix3, Vector3};
use std::ops::Range;

/// Number of joints of an arm that turn its two limbs.
pub(crate) const LIMB_JOINTS: usize = 5;
/// Largest difference between mirrored axes. It allows for the rounding of the URDF's angles (1e-11 rad in
/// common files).
const MIRROR_TOLERANCE: f64 = 1e-9;
/// Largest cosine between neighbouring axes that the retargeting takes for orthogonal. It allows for angles that a
/// URDF writes with seven digits.
const ORTHOGONAL_TOLERANCE: f64 = 1e-6;

/// One arm.
///
/// The rotations of its limbs are in the torso frame (x forward, y left, z up). They are differences from the
/// reference posture (the T-pose). Rot(n, w) is the rotation by w about n. Then the rotations are
/// U(q) = Rot(axes 1, q1 - ref1) Rot(axes 2, q2 - ref2) Rot(axes 3, q3 - ref3) of the upper arm and
/// F(q) = U(q) Rot(axes 4, q4 - ref4) Rot(axes 5, q5 - ref5) of the forearm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Arm {
    /// Indices of its joints in the order of messages. They follow one another.
    pub joints: [usize; ARM_JOINTS],
    /// For each joint: q = sign * q of the same joint of the left arm in the mirrored posture. All 1 for the left
    /// arm. The signs of joints 6 and 7 are 1 where these two do not mirror.
    pub signs: [f64; ARM_JOINTS],
    /// Unit axis of joints 1 to 5 in the torso frame while the arm is at the reference posture.
    pub axes: [Vector3<f64>; LIMB_JOINTS],
    /// Positions of joints 1 to 5 in the T-pose, rad.
    pub reference: [f64; LIMB_JOINTS],
    /// Lower limits of joints 1 to 5 in force, rad.
    pub q_min: [f64; LIMB_JOINTS],
    /// Upper limits of joints 1 to 5 in force, rad.
    pub q_max: [f64; LIMB_JOINTS],
}

impl Arm {
    /// A placeholder until the model is complete enough to derive the arm.
    pub(crate) fn blank() -> Self {
        Self {
            joints: [0; ARM_JOINTS],
            signs: [1.0; ARM_JOINTS],
            axes: Default::default(),
            reference: Default::default(),
            q_min: Default::default(),
            q_max: Default::default(),
        }
    }

    /// Range of its joints in the order of messages.
    pub fn range(&self) -> Range<usize> {
        self.joints[0]..self.joints[0] + ARM_JOINTS
    }

    /// Converts positions or velocities of joints 1 to 5 between this arm and the left arm that mirrors it. Its own
    /// inverse.
    pub fn mirrored(&self, q: &[f64; LIMB_JOINTS]) -> [f64; LIMB_JOINTS] {
        std::array::from_fn(|i| self.signs[i] * q[i])
    }

    /// Rotations of the upper arm and of the forearm at the positions of joints 1 to 5, rad.
    pub fn limb_rotations(&self, q: &[f64; LIMB_JOINTS]) -> (Matrix3<f64>, Matrix3<f64>) {
        let turn = |i: usize| rotation(&self.axes[i], q[i] - self.reference[i]);
        let upper = turn(0) * turn(1) * turn(2);
        (upper, upper * turn(3) * turn(4))
    }
}

impl Model {
    /// Positions of all joints in the T-pose: both arms at their reference postures, wrists and torso at home.
    pub fn t_pose(&self) -> [f64; JOINTS_MAX] {
        let mut q = self.home;
        for arm in &self.arms {
            arm.joints.iter().zip(arm.reference).for_each(|(&joint, reference)| q[joint] = reference);
        }
        q
    }

    /// The middle of the left (0) or right (1) hand, base frame, m: where it grasps, which is the centre of its payload. The
    /// origin of the last joint if the robot's file names none.
    pub fn hand(&self, frames: &Frames, side: usize) -> Vector3<f64> {
        let center = self.payload[side].map_or_else(Vector3::zeros, |payload| payload.center);
        frames.base_from_body[self.arms[side].joints[ARM_JOINTS - 1] + 1].transform_point(&center)
    }

    /// Derives the arm with these joints, whose T-pose is `reference` and whose shoulder is on the body
    /// `torso`.
    pub(crate) fn derive_arm(&self, joints: [usize; ARM_JOINTS], reference: [f64; LIMB_JOINTS], torso: usize) -> Arm {
        let axes = self.axes(joints, reference, torso);
        Arm {
            joints,
            signs: [1.0; ARM_JOINTS],
            axes: std::array::from_fn(|i| axes[i]),
            reference,
            q_min: std::array::from_fn(|i| self.limits[joints[i]].q_min),
            q_max: std::array::from_fn(|i| self.limits[joints[i]].q_max),
        }
    }

    /// Unit axes of all joints of an arm in the torso frame, at the reference posture and with a straight wrist.
    fn axes(
        &self,
        joints: [usize; ARM_JOINTS],
        reference: [f64; LIMB_JOINTS],
        torso: usize,
    ) -> [Vector3<f64>; ARM_JOINTS] {
        let mut q = [0.0; JOINTS_MAX];
        (0..LIMB_JOINTS).for_each(|i| q[joints[i]] = reference[i]);
        self.axes_at(&q, joints, torso)
    }

    /// Unit axes of these joints in the torso frame, with all joints at the positions `q`.
    pub(crate) fn axes_at<const N: usize>(
        &self,
        q: &[f64; JOINTS_MAX],
        joints: [usize; N],
        torso: usize,
    ) -> [Vector3<f64>; N] {
        let mut frames = Frames::default();
        self.forward(q, &mut frames);
        let torso_from_base = frames.base_from_body[torso].r.transpose();
        joints.map(|j| (torso_from_base * frames.base_from_body[j + 1].r * self.joint_frames[j].axis).normalize())
    }

    /// Checks that three orthogonal axes turn each upper arm and two more the forearm: the retargeting solves such
    /// arms in closed form.
    pub(crate) fn check_shoulders(&self, file: &str) -> Result<(), RobotError> {
        for arm in &self.arms {
            for (a, b) in [(0, 1), (1, 2), (3, 4)] {
                let cosine = arm.axes[a].dot(&arm.axes[b]).abs();
                if !(cosine <= ORTHOGONAL_TOLERANCE) {
                    let name = |i: usize| &self.joint_names[arm.joints[i]];
                    return Err(RobotError::Joint {
                        file: file.into(),
                        joint: name(b).clone(),
                        key: format!("cosine between its axis and that of `{}`", name(a)),
                        value: cosine,
                        bound: format!(
                            "at most {ORTHOGONAL_TOLERANCE:e}: an arm must have three orthogonal axes in its shoulder, \
                             and two at elbow and forearm"
                        ),
                    });
                }
            }
        }
        Ok(())
    }

    /// Checks that the right arm is the mirror image of the left one, because one arm model serves both, and derives
    /// the sign of each joint. The mirror at the plane y = 0 maps a rotation axis (x, y, z) to (-x, y, -z) at the
    /// same angle. So an axis along it has the sign 1, and one against it the sign -1.
    pub(crate) fn check_mirror(&mut self, file: &str) -> Result<(), RobotError> {
        let [left, right] = self.arms;
        let axes = [left, right].map(|arm| self.axes(arm.joints, arm.reference, self.torso_body));
        for (i, &n) in axes[0].iter().enumerate() {
            let joint = self.joint_names[right.joints[i]].clone();
            let refuse = |key: &str, value: f64, bound: String| RobotError::Joint {
                file: file.into(),
                joint: joint.clone(),
                key: key.into(),
                value,
                bound,
            };
            let image = Vector3::new(-n.x, n.y, -n.z);
            let [along, against] = [1.0, -1.0].map(|sign| (axes[1][i] - image * sign).norm());
            let off = along.min(against);
            let mirrors = off <= MIRROR_TOLERANCE;
            let sign = if mirrors && against < along { -1.0 } else { 1.0 };
            if i < LIMB_JOINTS {
                if !mirrors {
                    let bound = format!("must mirror the left arm's within {MIRROR_TOLERANCE:e}");
                    return Err(refuse("deviation of the axis", off, bound));
                }
                let wanted = sign * left.reference[i];
                if wanted != right.reference[i] {
                    let bound = format!("must mirror the left arm's: {wanted}");
                    return Err(refuse("reference_rad", right.reference[i], bound));
                }
            }
            self.arms[1].signs[i] = sign;
            let (l, r) = (mirrored(&self.limits[left.joints[i]], sign), &self.limits[right.joints[i]]);
            for (key, value, bound) in named_limits(r).iter().zip(named_limits(&l)).map(|(r, l)| (r.0, r.1, l.1)) {
                if value != bound {
                    return Err(refuse(key, value, format!("must mirror the left arm's: {bound}")));
                }
            }
        }
        Ok(())
    }
}

/// Limits of the joint that moves by `sign` times the position of a joint with these limits.
fn mirrored(limits: &JointLimits, sign: f64) -> JointLimits {
    if sign > 0.0 { *limits } else { JointLimits { q_min: -limits.q_max, q_max: -limits.q_min, ..*limits } }
}

fn named_limits(limits: &JointLimits) -> [(&'static str, f64); 5] {
    [
        ("position min", limits.q_min),
        ("position max", limits.q_max),
        ("velocity max", limits.v_max),
        ("acceleration max", limits.a_max),
        ("jerk max", limits.j_max),
    ]
}
