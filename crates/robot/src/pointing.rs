//! Joints in a row that turn what a person points: those of a wrist, or of a head. And their positions that come nearest to a
//! rotation.
//!
//! Let a, b be the axes of two joints, t1, t2 the angles and (w, x) the wanted rotation as a quaternion. With
//! u = (cos t1/2, sin t1/2) and v = (cos t2/2, sin t2/2) the quaternions of Rot(a, t1) Rot(b, t2) and of the wanted rotation
//! have the product
//!
//! ```text
//! u^T M v,   M = [ w        b . x                  ]
//!                [ a . x    (a x b) . x - (a . b) w ]
//! ```
//!
//! Its magnitude is the cosine of half the angle between them. It is largest at the first singular vectors of M. If these lie
//! outside of the range, the best point lies on its edge.
//!
//! Of three joints, the first one and the other two take turns: each is solved with the rest held.

use crate::error::RobotError;
use crate::model::{Model, Source};
use crate::pose::rotation;
use messages::JOINTS_MAX;
use nalgebra::{Matrix2, Matrix3, UnitQuaternion, Vector2, Vector3};
use std::f64::consts::{PI, TAU};

/// Largest number of joints in a row.
pub const POINTING_JOINTS: usize = 3;
/// Turns that the first of three joints and the other two take. The product rises in each. Of 4, 8, 16 and 32, 16 come within
/// 0.1 degrees of the best (`crates/robot/tests/pointing.rs`).
const TURNS: u32 = 16;

/// Up to three revolute joints in a row. Rot(n, w) is the rotation by w about n. In the torso frame (x forward, y left, z up)
/// they turn a hand against its forearm, or a head against the chest, by
/// R(q) = Rot(axes 1, q1 - home1) Rot(axes 2, q2 - home2) Rot(axes 3, q3 - home3).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PointingJoints {
    /// Indices of the joints in the order of messages. `None` beyond the last one: its axis is zero, and so is its position.
    pub joints: [Option<usize>; POINTING_JOINTS],
    /// Unit axes in the torso frame. All joints are at home, and an arm is in its T-pose.
    pub axes: [Vector3<f64>; POINTING_JOINTS],
    /// Positions of a straight hand or head, rad: those of the home posture.
    pub home: [f64; POINTING_JOINTS],
    /// Lower limits in force, rad.
    pub q_min: [f64; POINTING_JOINTS],
    /// Upper limits in force, rad.
    pub q_max: [f64; POINTING_JOINTS],
}

impl PointingJoints {
    /// No joint: a hand that does not move against its forearm.
    pub const NONE: Self = {
        let zero = [0.0; POINTING_JOINTS];
        let axes = [Vector3::new(0.0, 0.0, 0.0); POINTING_JOINTS];
        Self { joints: [None; POINTING_JOINTS], axes, home: zero, q_min: zero, q_max: zero }
    };

    /// R(q) at the positions `q`, rad.
    pub fn rotation(&self, q: [f64; POINTING_JOINTS]) -> Matrix3<f64> {
        let turn = |i: usize| rotation(&self.axes[i], q[i] - self.home[i]);
        let two = turn(0) * turn(1);
        if self.joints[2].is_some() { two * turn(2) } else { two }
    }

    /// The joints and these positions of theirs.
    pub fn with(&self, q: [f64; POINTING_JOINTS]) -> impl Iterator<Item = (usize, f64)> {
        self.joints.into_iter().zip(q).filter_map(|(joint, q)| joint.map(|joint| (joint, q)))
    }

    /// Returns the positions of the joints, rad, within their limits, that turn by nearly `wanted` in the torso frame. For up to
    /// two joints no other positions within the limits come nearer. The search of three begins at the positions `from`.
    ///
    /// ```
    /// # let read = |kind| std::fs::read_to_string(format!("../../config/robots/tiago_dual.{kind}"));
    /// # let model = robot::Model::from_text("tiago_dual.toml", &read("toml")?, "tiago_dual.urdf", &read("urdf")?)?;
    /// use nalgebra::UnitQuaternion;
    ///
    /// let head = model.head.unwrap();
    /// let to_the_left = UnitQuaternion::from_euler_angles(0.0, 0.0, 0.3);
    /// let [pan, tilt, _] = head.nearest(&to_the_left, head.home);
    /// assert!((pan - 0.3).abs() < 1e-9 && tilt.abs() < 1e-9);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn nearest(&self, wanted: &UnitQuaternion<f64>, from: [f64; POINTING_JOINTS]) -> [f64; POINTING_JOINTS] {
        if self.joints[2].is_none() {
            let [first, second] = self.nearest_two([0, 1], wanted);
            return [first, second, self.home[2]];
        }
        let turn = |i: usize, q: f64| UnitQuaternion::new(self.axes[i] * (q - self.home[i]));
        let mut q = from;
        for _ in 0..TURNS {
            // The first joint turns before the others: R1 = wanted (R2 R3)^-1. Its partner of no axis stays at home.
            let before = wanted * (turn(1, q[1]) * turn(2, q[2])).inverse();
            [q[0], _] = self.alone(0).nearest_two([0, 1], &before);
            [q[1], q[2]] = self.nearest_two([1, 2], &(turn(0, q[0]).inverse() * wanted));
        }
        q
    }

    /// Joint `i` alone.
    fn alone(&self, i: usize) -> Self {
        let mut one = Self::NONE;
        (one.joints[0], one.axes[0], one.home[0]) = (self.joints[i], self.axes[i], self.home[i]);
        (one.q_min[0], one.q_max[0]) = (self.q_min[i], self.q_max[i]);
        one
    }

    /// The best positions of joints `at`, rad, which turn by nearly `wanted`.
    fn nearest_two(&self, at: [usize; 2], wanted: &UnitQuaternion<f64>) -> [f64; 2] {
        let m = product(at.map(|i| self.axes[i]), wanted);
        let bounds = at.map(|i| [self.q_min[i] - self.home[i], self.q_max[i] - self.home[i]]);
        let position = |turn: [f64; 2]| {
            let inside = |i: usize, turn: f64| (self.home[i] + turn).max(self.q_min[i]).min(self.q_max[i]);
            [inside(at[0], turn[0]), inside(at[1], turn[1])]
        };
        // The largest product, without limits.
        let (p, q) = (m.column(0), m.column(1));
        let v = half((2.0 * p.dot(&q)).atan2(p.norm_squared() - q.norm_squared()));
        let free = [twice_angle(m * v), twice_angle(v)];
        if let [Some(first), Some(second)] = [0, 1].map(|i| inside(free[i], bounds[i])) {
            return position([first, second]);
        }
        let value = |turn: &[f64; 2]| (half(turn[0]).transpose() * m * half(turn[1])).x.abs();
        let mut best = [bounds[0][0], bounds[1][0]];
        let mut try_this = |turn: [f64; 2]| {
            if value(&turn) > value(&best) {
                best = turn;
            }
        };
        for first in bounds[0] {
            // The corners, and the best of each edge.
            bounds[1].into_iter().for_each(|second| try_this([first, second]));
            let second = inside(twice_angle(m.transpose() * half(first)), bounds[1]);
            second.into_iter().for_each(|second| try_this([first, second]));
        }
        for second in bounds[1] {
            let first = inside(twice_angle(m * half(second)), bounds[0]);
            first.into_iter().for_each(|first| try_this([first, second]));
        }
        position(best)
    }
}

/// M of the module's text.
fn product([a, b]: [Vector3<f64>; 2], wanted: &UnitQuaternion<f64>) -> Matrix2<f64> {
    let (w, x) = (wanted.w, wanted.imag());
    Matrix2::new(w, b.dot(&x), a.dot(&x), a.cross(&b).dot(&x) - a.dot(&b) * w)
}

/// The unit vector at half of an angle.
fn half(angle: f64) -> Vector2<f64> {
    let (sin, cos) = (0.5 * angle).sin_cos();
    Vector2::new(cos, sin)
}

/// Twice the angle of a vector, from -pi to pi: a vector and its opposite are the same turn.
fn twice_angle(v: Vector2<f64>) -> f64 {
    let angle = 2.0 * v.y.atan2(v.x);
    if angle > PI {
        angle - TAU
    } else if angle < -PI {
        angle + TAU
    } else {
        angle
    }
}

/// Returns the angle, or one that differs by whole turns, between the bounds.
fn inside(angle: f64, [min, max]: [f64; 2]) -> Option<f64> {
    [angle, angle - TAU, angle + TAU].into_iter().find(|angle| (min..=max).contains(angle))
}

impl Model {
    /// Derives the joints of a wrist or a head. `t_pose`: positions of the arms' joints in the T-pose, on top of the home
    /// posture.
    pub(crate) fn pointing(
        &self,
        joints: [Option<usize>; POINTING_JOINTS],
        t_pose: &[f64; JOINTS_MAX],
    ) -> PointingJoints {
        let mut out = PointingJoints { joints, ..PointingJoints::NONE };
        for (i, j) in joints.into_iter().enumerate().filter_map(|(i, j)| Some((i, j?))) {
            [out.axes[i]] = self.axes_at(t_pose, [j]);
            out.home[i] = self.home[j];
            (out.q_min[i], out.q_max[i]) = (self.limits[j].q_min, self.limits[j].q_max);
        }
        out
    }
}

impl Source<'_> {
    /// The joints that turn the head, as the robot file names them.
    pub(crate) fn head(
        &self,
        names: Option<&[String; 2]>,
        model: &Model,
    ) -> Result<Option<PointingJoints>, RobotError> {
        let Some(names) = names else { return Ok(None) };
        self.check_names("head_joints", names.iter(), &model.joint_names[..model.body_count])?;
        let joints = names.each_ref().map(|name| model.joint_names.iter().position(|other| other == name).unwrap_or(0));
        let head = model.pointing([Some(joints[0]), Some(joints[1]), None], &model.home);
        let carries = |joint: usize, body: usize| {
            std::iter::successors(Some(body), |&body| model.parent_body(body)).any(|body| body == joint + 1)
        };
        // One joint twice, or two that turn about the same axis, have no product.
        let turn = joints.iter().all(|&j| !model.prismatic[j]) && head.axes[0].cross(&head.axes[1]).norm() > 0.5;
        let mut others = model.arms.iter().map(|arm| arm.range().start + 1).chain([model.torso_body]);
        if !turn || !carries(joints[0], joints[1] + 1) || others.any(|body| carries(joints[0], body)) {
            let bound = "must turn about two axes, the lower joint first, and carry neither torso nor arm";
            return Err(self.value("head_joints", format!("`{}`, `{}`", names[0], names[1]), bound));
        }
        Ok(Some(head))
    }
}
