//! An arm for the retargeting: up to five joints turn its two limbs, and up to three its hand.

use crate::error::RobotError;
use crate::kinematics::Frames;
use crate::limbs::axis_on_side;
use crate::limits::JointLimits;
use crate::model::{BodyLink, Model};
use crate::pointing::POINTING_JOINTS;
use crate::pose::{Pose, rotation};
use messages::{ARM_JOINTS, JOINTS_MAX};
use nalgebra::{Matrix3, Vector3};
use std::fmt;
use std::ops::Range;

/// Slots of the joints that turn an arm's two limbs.
pub(crate) const LIMB_JOINTS: usize = 5;
/// Slots of the joints that turn the upper arm.
pub(crate) const UPPER_JOINTS: usize = 3;
/// Largest difference between mirrored axes. Makers write three to six digits: a public URDF of ABB's YuMi is 0.004 off. This much
/// costs 0.3 degrees of a limb.
const AXIS_TOLERANCE: f64 = 5e-3;
/// Largest cosine between the axes of neighbouring joints of one limb: an angle of 18 degrees. Assumption.
const COSINE_MAX: f64 = 0.95;
/// Largest difference between the ends of two mirrored ranges, rad. The narrower range serves both arms.
const RANGE_TOLERANCE_RAD: f64 = 0.02;
/// The same for speed, acceleration and jerk, as a share.
const SHARE_TOLERANCE: f64 = 1e-3;

/// One arm of four to eight joints.
///
/// Its joints stand in eight slots: three for the upper arm, two for the forearm, three for the hand. A slot beyond the joints
/// that the arm has there is empty. Its axis, its position and its limits are zero, so it turns nothing.
///
/// The rotations of its limbs are in the torso frame (x forward, y left, z up). They are differences from the
/// reference posture (the T-pose). Rot(n, w) is the rotation by w about n. Then the rotations are
/// U(q) = Rot(axes 1, q1 - ref1) Rot(axes 2, q2 - ref2) Rot(axes 3, q3 - ref3) of the upper arm and
/// F(q) = U(q) Rot(axes 4, q4 - ref4) Rot(axes 5, q5 - ref5) of the forearm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Arm {
    /// Index of the joint in each slot, in the order of messages. They follow one another.
    pub slots: [Option<usize>; ARM_JOINTS],
    /// For each slot: q = sign * q of the same joint of the left arm in the mirrored posture. All 1 for the left
    /// arm. The signs of the hand's joints are 1 where these do not mirror.
    pub signs: [f64; ARM_JOINTS],
    /// Unit axis of the limbs' joints in the torso frame while the arm is at the reference posture.
    pub axes: [Vector3<f64>; LIMB_JOINTS],
    /// Positions of the limbs' joints in the T-pose, rad.
    pub reference: [f64; LIMB_JOINTS],
    /// Lower limits of the limbs' joints in force, rad.
    pub q_min: [f64; LIMB_JOINTS],
    /// Upper limits of the limbs' joints in force, rad.
    pub q_max: [f64; LIMB_JOINTS],
}

/// Number of joints of an arm that turn its upper arm, its forearm and its hand.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub(crate) struct ArmShape {
    pub(crate) upper: usize,
    pub(crate) fore: usize,
    pub(crate) hand: usize,
}

impl fmt::Display for ArmShape {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} + {} + {}", self.upper, self.fore, self.hand)
    }
}

impl ArmShape {
    /// Most joints of each part.
    pub(crate) const MOST: Self = Self { upper: UPPER_JOINTS, fore: LIMB_JOINTS - UPPER_JOINTS, hand: POINTING_JOINTS };

    /// Number of joints.
    pub(crate) fn joints(&self) -> usize {
        self.upper + self.fore + self.hand
    }

    /// The slots of the joints in their order.
    pub(crate) fn slots(&self) -> impl Iterator<Item = usize> + use<> {
        let parts = [(0, self.upper), (UPPER_JOINTS, self.fore), (LIMB_JOINTS, self.hand)];
        parts.into_iter().flat_map(|(first, count)| first..first + count)
    }

    /// The values of the limbs' joints, in their slots.
    pub(crate) fn in_slots(&self, values: &[f64]) -> [f64; LIMB_JOINTS] {
        let mut out = [0.0; LIMB_JOINTS];
        self.slots().zip(values).for_each(|(slot, value)| out[slot] = *value);
        out
    }
}

impl Arm {
    /// A placeholder until the model is complete enough to derive the arm.
    pub(crate) fn blank() -> Self {
        Self {
            slots: [None; ARM_JOINTS],
            signs: [1.0; ARM_JOINTS],
            axes: Default::default(),
            reference: Default::default(),
            q_min: Default::default(),
            q_max: Default::default(),
        }
    }

    /// The arm of this shape whose joints begin with `first`.
    pub(crate) fn with_joints(first: usize, shape: &ArmShape) -> Self {
        let mut arm = Self::blank();
        shape.slots().zip(first..).for_each(|(slot, joint)| arm.slots[slot] = Some(joint));
        arm
    }

    /// Its joints in the order of messages.
    pub fn range(&self) -> Range<usize> {
        let mut all = self.slots.into_iter().flatten();
        let first = all.next().unwrap_or(0);
        first..all.last().unwrap_or(first) + 1
    }

    /// The name of each part that joints turn, and the slots of these.
    pub fn parts(&self) -> impl Iterator<Item = (&'static str, &[Option<usize>])> {
        let (upper, rest) = self.slots.split_at(UPPER_JOINTS);
        let (fore, hand) = rest.split_at(LIMB_JOINTS - UPPER_JOINTS);
        let parts = [("upper arm", upper), ("forearm", fore), ("hand", hand)];
        parts.into_iter().filter(|(_, slots)| slots.iter().any(Option::is_some))
    }

    /// The joints that turn the limbs.
    pub fn limb_joints(&self) -> impl Iterator<Item = usize> + use<> {
        let slots = self.slots;
        slots.into_iter().take(LIMB_JOINTS).flatten()
    }

    /// The joints that turn the hand.
    pub fn hand_joints(&self) -> [Option<usize>; POINTING_JOINTS] {
        std::array::from_fn(|i| self.slots[LIMB_JOINTS + i])
    }

    /// The bodies of the upper arm and of the forearm.
    pub fn limb_bodies(&self) -> [usize; 2] {
        [0..UPPER_JOINTS, UPPER_JOINTS..LIMB_JOINTS]
            .map(|part| 1 + self.slots[part].iter().flatten().last().map_or(0, |j| *j))
    }

    /// The body of the hand.
    pub fn hand_body(&self) -> usize {
        self.range().end
    }

    /// The joint of the elbow.
    pub fn elbow(&self) -> usize {
        self.slots[UPPER_JOINTS].unwrap_or(0)
    }

    /// True for a limb, upper arm and forearm, that can turn about its own length. The other one is matched by its
    /// direction alone.
    pub fn rolls(&self) -> [bool; 2] {
        [self.slots[UPPER_JOINTS - 1].is_some(), self.slots[LIMB_JOINTS - 1].is_some()]
    }

    /// The signs of its joints, in the order of messages.
    pub fn joint_signs(&self) -> impl Iterator<Item = f64> + use<> {
        let arm = *self;
        arm.slots.into_iter().zip(arm.signs).filter_map(|(slot, sign)| slot.map(|_| sign))
    }

    /// Positions or velocities of the limbs' joints in the slots, of those of all joints.
    pub fn limb_values(&self, all: &[f64; JOINTS_MAX]) -> [f64; LIMB_JOINTS] {
        std::array::from_fn(|i| self.slots[i].map_or(0.0, |joint| all[joint]))
    }

    /// Writes the values of the limbs' joints into those of all joints.
    pub fn set_limbs(&self, values: &[f64; LIMB_JOINTS], all: &mut [f64; JOINTS_MAX]) {
        self.slots.iter().zip(values).for_each(|(slot, value)| slot.iter().for_each(|joint| all[*joint] = *value));
    }

    /// Converts positions or velocities of the limbs' joints between this arm and the left arm that mirrors it. Its own
    /// inverse.
    pub fn mirrored(&self, q: &[f64; LIMB_JOINTS]) -> [f64; LIMB_JOINTS] {
        std::array::from_fn(|i| self.signs[i] * q[i])
    }

    /// Rotations of the upper arm and of the forearm at the positions of the limbs' joints, rad.
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
            arm.set_limbs(&arm.reference, &mut q);
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
            let mut joints = self.arms.iter().flat_map(Arm::range);
            joints.any(|j| j + 1 == link.body) && link.body_from_link == Pose::identity()
        };
        let light = self.links.iter().filter(of_arm).filter(|link| link.inertia.mass_kg <= 0.0);
        light.map(|link| link.name.as_str()).collect()
    }

    /// The middle of the left (0) or right (1) hand, base frame, m: where it grasps, which is the centre of its payload. The
    /// origin of the last joint if the robot's file names none.
    pub fn hand_center(&self, frames: &Frames, side: usize) -> Vector3<f64> {
        let center = self.payload[side].map_or_else(Vector3::zeros, |payload| payload.center);
        frames.base_from_body[self.arms[side].hand_body()].transform_point(&center)
    }

    /// The arm whose geometry stands for the left (0) or the right one (1): the left one for both if they mirror.
    pub fn measured_side(&self, side: usize) -> usize {
        if self.mirrored { 0 } else { side }
    }

    /// The left (0) or the right arm (1) as a left one, with the axes of its mirror image. All postures are solved for it.
    pub fn as_left(&self, side: usize) -> Arm {
        let side = self.measured_side(side);
        Arm { axes: self.arms[side].axes.map(|axis| axis_on_side(side, axis)), ..self.arms[side] }
    }

    /// Origins of an arm's limb slots and the middle of its hand, base frame, m. An empty slot has that of the next joint.
    pub fn limb_places(&self, frames: &Frames, side: usize) -> [Vector3<f64>; LIMB_JOINTS + 1] {
        let mut places = [self.hand_center(frames, side); LIMB_JOINTS + 1];
        for slot in (0..LIMB_JOINTS).rev() {
            let joint = self.arms[side].slots[slot];
            places[slot] = joint.map_or(places[slot + 1], |joint| frames.base_from_body[joint + 1].t);
        }
        places
    }

    /// Derives the arm with the joints of `arm`, whose T-pose is `reference`.
    pub(crate) fn derive_arm(&self, arm: &Arm, reference: [f64; LIMB_JOINTS]) -> Arm {
        let axes = self.axes(&Arm { reference, ..*arm });
        let limit =
            |i: usize, bound: fn(&JointLimits) -> f64| arm.slots[i].map_or(0.0, |joint| bound(&self.limits[joint]));
        Arm {
            slots: arm.slots,
            signs: [1.0; ARM_JOINTS],
            axes: std::array::from_fn(|i| axes[i]),
            reference,
            q_min: std::array::from_fn(|i| limit(i, |limits| limits.q_min)),
            q_max: std::array::from_fn(|i| limit(i, |limits| limits.q_max)),
        }
    }

    /// Unit axes of all joints of an arm in the torso frame, at its reference posture and with a straight wrist.
    fn axes(&self, arm: &Arm) -> [Vector3<f64>; ARM_JOINTS] {
        let mut q = [0.0; JOINTS_MAX];
        arm.set_limbs(&arm.reference, &mut q);
        arm.slots.map(|slot| slot.map_or_else(Vector3::zeros, |joint| self.axes_at(&q, [joint])[0]))
    }

    /// Unit axes of these joints in the torso frame, with all joints at the positions `q`.
    pub(crate) fn axes_at<const N: usize>(&self, q: &[f64; JOINTS_MAX], joints: [usize; N]) -> [Vector3<f64>; N] {
        let mut frames = Frames::default();
        self.forward(q, &mut frames);
        let torso_from_base = self.base_from_torso(&frames).transpose();
        joints.map(|j| (torso_from_base * frames.base_from_body[j + 1].r * self.joint_frames[j].axis).normalize())
    }

    /// Checks that neighbouring axes of a limb are not parallel: two joints that turn the same limb about one line are one.
    pub(crate) fn check_shoulders(&self, file: &str) -> Result<(), RobotError> {
        let mut errors = Vec::new();
        for arm in &self.arms {
            for (a, b) in [(0, 1), (1, 2), (3, 4)] {
                let [Some(first), Some(second)] = [a, b].map(|slot| arm.slots[slot]) else { continue };
                let cosine = arm.axes[a].dot(&arm.axes[b]).abs();
                if !(cosine <= COSINE_MAX) {
                    let (joint, file) = (self.joint_names[second].clone(), file.into());
                    let key = format!("cosine between its axis and that of `{}`", self.joint_names[first]);
                    let bound = format!("at most {COSINE_MAX}: both would turn the limb in the same way");
                    errors.push(RobotError::Joint { file, joint, key, value: cosine, bound });
                }
            }
        }
        RobotError::all(errors)
    }

    /// Checks that the right arm is the mirror image of the left one, so that one arm model serves both, and derives
    /// the sign of each joint. The mirror at the plane y = 0 maps a rotation axis (x, y, z) to (-x, y, -z) at the
    /// same angle. So an axis along it has the sign 1, and one against it the sign -1. Limits that differ by the rounding of
    /// a text become the narrower ones, for both arms.
    pub(crate) fn mirror(&mut self, file: &str) -> Result<(), RobotError> {
        let [left, right] = self.arms;
        let axes = [left, right].map(|arm| self.axes(&arm));
        let (mut errors, mut reference) = (Vec::new(), right.reference);
        for (i, &n) in axes[0].iter().enumerate() {
            let [Some(l), Some(r)] = [left.slots[i], right.slots[i]] else { continue };
            let joint = self.joint_names[r].clone();
            let mut refuse = |key: &str, value: f64, bound: String| {
                let (file, joint, key) = (file.into(), joint.clone(), key.into());
                errors.push(RobotError::Joint { file, joint, key, value, bound });
            };
            let image = axis_on_side(1, n);
            let [along, against] = [1.0, -1.0].map(|sign| (axes[1][i] - image * sign).norm());
            let off = along.min(against);
            let mirrors = off <= AXIS_TOLERANCE;
            let sign = if mirrors && against < along { -1.0 } else { 1.0 };
            self.arms[1].signs[i] = sign;
            if i < LIMB_JOINTS {
                let wanted = sign * left.reference[i];
                if !mirrors {
                    let bound = format!(
                        "must mirror the left arm's within {AXIS_TOLERANCE:e}, or `mirrored = false` under [arms]"
                    );
                    refuse("deviation of the axis", off, bound);
                } else if !((wanted - right.reference[i]).abs() <= AXIS_TOLERANCE) {
                    refuse("reference_rad", right.reference[i], format!("must mirror the left arm's: {wanted}"));
                }
                reference[i] = wanted;
            }
            let own = [l, r].map(|joint| self.limits[joint]);
            let image = mirrored(&own[0], sign);
            for ((key, value, within), (_, bound, _)) in named_limits(&own[1]).into_iter().zip(named_limits(&image)) {
                if !((value - bound).abs() <= within) {
                    refuse(key, value, format!("must mirror the left arm's: {bound}"));
                }
            }
            let both = narrower(&own[1], &image);
            self.limits[r] = JointLimits { effort_max: own[1].effort_max, ..both };
            self.limits[l] = JointLimits { effort_max: own[0].effort_max, ..mirrored(&both, sign) };
        }
        RobotError::all(errors)?;
        let signs = self.arms[1].signs;
        self.arms[0] = self.derive_arm(&left, left.reference);
        self.arms[1] = Arm { signs, ..self.derive_arm(&right, reference) };
        Ok(())
    }

    /// Refuses arms of which the left one is the right one: the robot would move as a mirror image.
    pub(crate) fn check_sides(&self, file: &str) -> Result<(), RobotError> {
        let mut frames = Frames::default();
        self.forward(&self.t_pose(), &mut frames);
        let [left, right] = [0, 1].map(|side| frames.base_from_body[self.arms[side].hand_body()].t);
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
