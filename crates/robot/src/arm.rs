//! An arm for the retargeting: five joints turn its two limbs.

use crate::error::RobotError;
use crate::kinematics::Frames;
use crate::limits::JointLimits;
use crate::model::{BodyLink, Model};
use crate::pose::{Pose, rotation};
use messages::{ARM_JOINTS, JOINTS_MAX};
use nalgebra::{Matrix3, Vector3};
use std::ops::Range;

/// Number of joints of an arm that turn its two limbs.
pub(crate) const LIMB_JOINTS: usize = 5;
/// Largest difference between mirrored axes, and largest cosine between neighbouring axes that the retargeting takes for
/// orthogonal. Makers write four to six digits. This much costs 0.06 degrees of a limb.
const AXIS_TOLERANCE: f64 = 1e-3;
/// Largest difference between the ends of two mirrored ranges, rad. The narrower range serves both arms.
const RANGE_TOLERANCE_RAD: f64 = 0.02;
/// The same for speed, acceleration and jerk, as a share.
const SHARE_TOLERANCE: f64 = 1e-3;

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

    /// The rotation of the torso frame (x forward, y left, z up) in the base frame.
    pub fn base_from_torso(&self, frames: &Frames) -> Matrix3<f64> {
        frames.base_from_body[self.torso_body].r * self.body_from_torso
    }

    /// The links that a joint of an arm moves and that have no mass. Torques leave them out.
    pub fn massless_links(&self) -> Vec<&str> {
        let of_arm = |link: &&BodyLink| {
            let mut joints = self.arms.iter().flat_map(|arm| arm.joints);
            joints.any(|j| j + 1 == link.body) && link.body_from_link == Pose::identity()
        };
        let light = self.links.iter().filter(of_arm).filter(|link| link.inertia.mass_kg <= 0.0);
        light.map(|link| link.name.as_str()).collect()
    }

    /// The middle of the left (0) or right (1) hand, base frame, m: where it grasps, which is the centre of its payload. The
    /// origin of the last joint if the robot's file names none.
    pub fn hand(&self, frames: &Frames, side: usize) -> Vector3<f64> {
        let center = self.payload[side].map_or_else(Vector3::zeros, |payload| payload.center);
        frames.base_from_body[self.arms[side].joints[ARM_JOINTS - 1] + 1].transform_point(&center)
    }

    /// Derives the arm with these joints, whose T-pose is `reference`.
    pub(crate) fn derive_arm(&self, joints: [usize; ARM_JOINTS], reference: [f64; LIMB_JOINTS]) -> Arm {
        let axes = self.axes(joints, reference);
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
    fn axes(&self, joints: [usize; ARM_JOINTS], reference: [f64; LIMB_JOINTS]) -> [Vector3<f64>; ARM_JOINTS] {
        let mut q = [0.0; JOINTS_MAX];
        (0..LIMB_JOINTS).for_each(|i| q[joints[i]] = reference[i]);
        self.axes_at(&q, joints)
    }

    /// Unit axes of these joints in the torso frame, with all joints at the positions `q`.
    pub(crate) fn axes_at<const N: usize>(&self, q: &[f64; JOINTS_MAX], joints: [usize; N]) -> [Vector3<f64>; N] {
        let mut frames = Frames::default();
        self.forward(q, &mut frames);
        let torso_from_base = self.base_from_torso(&frames).transpose();
        joints.map(|j| (torso_from_base * frames.base_from_body[j + 1].r * self.joint_frames[j].axis).normalize())
    }

    /// Checks that three orthogonal axes turn each upper arm and two more the forearm: the retargeting solves such
    /// arms in closed form.
    pub(crate) fn check_shoulders(&self, file: &str) -> Result<(), RobotError> {
        for arm in &self.arms {
            for (a, b) in [(0, 1), (1, 2), (3, 4)] {
                let cosine = arm.axes[a].dot(&arm.axes[b]).abs();
                if !(cosine <= AXIS_TOLERANCE) {
                    let name = |i: usize| &self.joint_names[arm.joints[i]];
                    return Err(RobotError::Joint {
                        file: file.into(),
                        joint: name(b).clone(),
                        key: format!("cosine between its axis and that of `{}`", name(a)),
                        value: cosine,
                        bound: format!(
                            "at most {AXIS_TOLERANCE:e}: an arm must have three orthogonal axes in its shoulder, \
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
    /// same angle. So an axis along it has the sign 1, and one against it the sign -1. Limits that differ by the rounding of
    /// a text become the narrower ones, for both arms.
    pub(crate) fn mirror(&mut self, file: &str) -> Result<(), RobotError> {
        let [left, right] = self.arms;
        let axes = [left, right].map(|arm| self.axes(arm.joints, arm.reference));
        let (mut errors, mut reference) = (Vec::new(), right.reference);
        for (i, &n) in axes[0].iter().enumerate() {
            let joint = self.joint_names[right.joints[i]].clone();
            let mut refuse = |key: &str, value: f64, bound: String| {
                let (file, joint, key) = (file.into(), joint.clone(), key.into());
                errors.push(RobotError::Joint { file, joint, key, value, bound });
            };
            let image = Vector3::new(-n.x, n.y, -n.z);
            let [along, against] = [1.0, -1.0].map(|sign| (axes[1][i] - image * sign).norm());
            let off = along.min(against);
            let mirrors = off <= AXIS_TOLERANCE;
            let sign = if mirrors && against < along { -1.0 } else { 1.0 };
            self.arms[1].signs[i] = sign;
            if i < LIMB_JOINTS {
                let wanted = sign * left.reference[i];
                if !mirrors {
                    let bound = format!("must mirror the left arm's within {AXIS_TOLERANCE:e}");
                    refuse("deviation of the axis", off, bound);
                } else if !((wanted - right.reference[i]).abs() <= AXIS_TOLERANCE) {
                    refuse("reference_rad", right.reference[i], format!("must mirror the left arm's: {wanted}"));
                }
                reference[i] = wanted;
            }
            let (l, r) = (self.limits[left.joints[i]], self.limits[right.joints[i]]);
            let image = mirrored(&l, sign);
            for ((key, value, within), (_, bound, _)) in named_limits(&r).into_iter().zip(named_limits(&image)) {
                if !((value - bound).abs() <= within) {
                    refuse(key, value, format!("must mirror the left arm's: {bound}"));
                }
            }
            let both = narrower(&r, &image);
            self.limits[right.joints[i]] = JointLimits { effort_max: r.effort_max, ..both };
            self.limits[left.joints[i]] = JointLimits { effort_max: l.effort_max, ..mirrored(&both, sign) };
        }
        RobotError::all(errors)?;
        let signs = self.arms[1].signs;
        self.arms[0] = self.derive_arm(left.joints, left.reference);
        self.arms[1] = Arm { signs, ..self.derive_arm(right.joints, reference) };
        Ok(())
    }

    /// Refuses arms of which the left one is the right one: the robot would move as a mirror image.
    pub(crate) fn check_sides(&self, file: &str) -> Result<(), RobotError> {
        let mut frames = Frames::default();
        self.forward(&self.t_pose(), &mut frames);
        let [left, right] = [0, 1].map(|side| frames.base_from_body[self.arms[side].joints[ARM_JOINTS - 1] + 1].t);
        let apart_m = (left - right).dot(&self.base_from_torso(&frames).column(1));
        if apart_m > 0.0 {
            return Ok(());
        }
        let bound = "must be above 0: exchange [arms.left] and [arms.right], or turn the torso frame by torso_rpy_rad";
        Err(RobotError::value(
            file,
            "left hand to the left of the right hand in the T-pose, m",
            format!("{apart_m:.3}"),
            bound,
        ))
    }
}

/// The narrower of two limits.
fn narrower(a: &JointLimits, b: &JointLimits) -> JointLimits {
    JointLimits {
        q_min: a.q_min.max(b.q_min),
        q_max: a.q_max.min(b.q_max),
        v_max: a.v_max.min(b.v_max),
        a_max: a.a_max.min(b.a_max),
        j_max: a.j_max.min(b.j_max),
        effort_max: a.effort_max.min(b.effort_max),
    }
}

/// Limits of the joint that moves by `sign` times the position of a joint with these limits.
fn mirrored(limits: &JointLimits, sign: f64) -> JointLimits {
    if sign > 0.0 { *limits } else { JointLimits { q_min: -limits.q_max, q_max: -limits.q_min, ..*limits } }
}

/// Each limit with its name, and how far the other arm's may be off.
fn named_limits(limits: &JointLimits) -> [(&'static str, f64, f64); 5] {
    [
        ("position min", limits.q_min, RANGE_TOLERANCE_RAD),
        ("position max", limits.q_max, RANGE_TOLERANCE_RAD),
        ("velocity max", limits.v_max, SHARE_TOLERANCE * limits.v_max),
        ("acceleration max", limits.a_max, SHARE_TOLERANCE * limits.a_max),
        ("jerk max", limits.j_max, SHARE_TOLERANCE * limits.j_max),
    ]
}
