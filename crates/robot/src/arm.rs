//! An arm for the retargeting: five joints turn its two limbs.

use crate::error::RobotError;
use crate::kinematics::Frames;
use crate::limits::JointLimits;
use crate::model::Model;
use crate::pose::rotation;
use messages::{ARM_JOINTS, JOINTS};
use nalgebra::{Matrix3, Vector3};

/// Number of joints of an arm that turn its two limbs.
const LIMB_JOINTS: usize = 5;
/// Largest difference between mirrored axes. It allows for the rounding of the URDF's angles (1e-11 rad in
/// common files).
const MIRROR_TOLERANCE: f64 = 1e-9;

/// One arm.
///
/// The rotations of its limbs are in the torso frame (x forward, y left, z up). They are differences from the
/// reference posture (the T-pose). Rot(n, w) is the rotation by w about n. Then the rotations are
/// U(q) = Rot(axes 1, q1 - ref1) Rot(axes 2, q2 - ref2) Rot(axes 3, q3 - ref3) of the upper arm and
/// F(q) = U(q) Rot(axes 4, q4 - ref4) Rot(axes 5, q5 - ref5) of the forearm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Arm {
    /// Indices of its joints in the fixed joint order.
    pub joints: [usize; ARM_JOINTS],
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
            axes: Default::default(),
            reference: Default::default(),
            q_min: Default::default(),
            q_max: Default::default(),
        }
    }

    /// Rotations of the upper arm and of the forearm at the positions of joints 1 to 5, rad.
    pub fn limb_rotations(&self, q: &[f64; LIMB_JOINTS]) -> (Matrix3<f64>, Matrix3<f64>) {
        let turn = |i: usize| rotation(&self.axes[i], q[i] - self.reference[i]);
        let upper = turn(0) * turn(1) * turn(2);
        (upper, upper * turn(3) * turn(4))
    }
}

impl Model {
    /// Derives the arm with these joints, whose T-pose is `reference` and whose shoulder is on the body
    /// `torso`.
    pub(crate) fn derive_arm(&self, joints: [usize; ARM_JOINTS], reference: [f64; LIMB_JOINTS], torso: usize) -> Arm {
        let mut q = [0.0; JOINTS];
        (0..LIMB_JOINTS).for_each(|i| q[joints[i]] = reference[i]);
        let mut frames = Frames::default();
        self.forward(&q, &mut frames);
        let torso_from_base = frames.base_from_body[torso].r.transpose();
        let axis = |i: usize| {
            let j = joints[i];
            (torso_from_base * frames.base_from_body[j + 1].r * self.joint_frames[j].axis).normalize()
        };
        Arm {
            joints,
            axes: std::array::from_fn(axis),
            reference,
            q_min: std::array::from_fn(|i| self.limits[joints[i]].q_min),
            q_max: std::array::from_fn(|i| self.limits[joints[i]].q_max),
        }
    }

    /// Checks that the right arm is the mirror image of the left one, because one arm model serves both. The
    /// mirror at the plane y = 0 maps a rotation axis (x, y, z) to (-x, y, -z) at the same angle.
    pub(crate) fn check_mirror(&self, file: &str) -> Result<(), RobotError> {
        let [left, right] = &self.arms;
        for i in 0..ARM_JOINTS {
            let joint = self.joint_names[right.joints[i]].clone();
            let refuse = |key: &str, value: f64, bound: String| RobotError::Joint {
                file: file.into(),
                joint: joint.clone(),
                key: key.into(),
                value,
                bound,
            };
            if i < LIMB_JOINTS {
                let n = left.axes[i];
                let off = (right.axes[i] - Vector3::new(-n.x, n.y, -n.z)).norm();
                if !(off <= MIRROR_TOLERANCE) {
                    let bound = format!("must mirror the left arm's within {MIRROR_TOLERANCE:e}");
                    return Err(refuse("deviation of the axis", off, bound));
                }
                if left.reference[i] != right.reference[i] {
                    let bound = format!("must equal the left arm's {}", left.reference[i]);
                    return Err(refuse("reference_rad", right.reference[i], bound));
                }
            }
            let (l, r) = (&self.limits[left.joints[i]], &self.limits[right.joints[i]]);
            for (key, value, bound) in named_limits(r).iter().zip(named_limits(l)).map(|(r, l)| (r.0, r.1, l.1)) {
                if value != bound {
                    return Err(refuse(key, value, format!("must equal the left arm's {bound}")));
                }
            }
        }
        Ok(())
    }
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
