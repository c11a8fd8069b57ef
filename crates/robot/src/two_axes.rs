//! Two joints in a row that turn what a person points: a wrist's last two, or those of a head. And their positions that
//! come nearest to a rotation, in closed form.
//!
//! Let a, b be the axes, t1, t2 the angles and (w, x) the wanted rotation as a quaternion. With u = (cos t1/2, sin t1/2)
//! and v = (cos t2/2, sin t2/2) the quaternions of Rot(a, t1) Rot(b, t2) and of the wanted rotation have the product
//!
//! ```text
//! u^T M v,   M = [ w        b . x                  ]
//!                [ a . x    (a x b) . x - (a . b) w ]
//! ```
//!
//! Its magnitude is the cosine of half the angle between them. It is largest at the first singular vectors of M. If these lie
//! outside of the range, the best point lies on its edge.

use crate::error::RobotError;
use crate::model::{Model, Source};
use crate::pose::rotation;
use nalgebra::{Matrix2, Matrix3, UnitQuaternion, Vector2, Vector3};
use std::f64::consts::{PI, TAU};

/// Two revolute joints in a row. Rot(n, w) is the rotation by w about n. In the torso frame (x forward, y left, z up)
/// they turn a hand against its forearm, or a head against the chest, by
/// R(q) = Rot(axes 1, q1 - home1) Rot(axes 2, q2 - home2).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TwoAxes {
    /// Indices of the joints in the order of messages.
    pub joints: [usize; 2],
    /// Unit axes in the torso frame. Both joints are at home, and an arm is in its T-pose.
    pub axes: [Vector3<f64>; 2],
    /// Positions of a straight hand or head, rad: those of the home posture.
    pub home: [f64; 2],
    /// Lower limits in force, rad.
    pub q_min: [f64; 2],
    /// Upper limits in force, rad.
    pub q_max: [f64; 2],
}

impl TwoAxes {
    /// A placeholder until the model is complete enough.
    pub(crate) fn blank() -> Self {
        let axes = [Vector3::zeros(); 2];
        Self { joints: [0; 2], axes, home: [0.0; 2], q_min: [0.0; 2], q_max: [0.0; 2] }
    }

    /// R(q) at the positions `q`, rad.
    pub fn rotation(&self, q: [f64; 2]) -> Matrix3<f64> {
        rotation(&self.axes[0], q[0] - self.home[0]) * rotation(&self.axes[1], q[1] - self.home[1])
    }

    /// Returns the positions of both joints, rad, within their limits, that turn by nearly `wanted` in the torso frame. No other
    /// positions within the limits come nearer.
    ///
    /// ```
    /// # let read = |kind| std::fs::read_to_string(format!("../../config/robots/tiago_dual.{kind}"));
    /// # let model = robot::Model::from_text("tiago_dual.toml", &read("toml")?, "tiago_dual.urdf", &read("urdf")?)?;
    /// use nalgebra::UnitQuaternion;
    ///
    /// let head = model.head.unwrap();
    /// let to_the_left = UnitQuaternion::from_euler_angles(0.0, 0.0, 0.3);
    /// let [pan, tilt] = head.nearest(&to_the_left);
    /// assert!((pan - 0.3).abs() < 1e-9 && tilt.abs() < 1e-9);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn nearest(&self, wanted: &UnitQuaternion<f64>) -> [f64; 2] {
        let m = product(self, wanted);
        let bounds = [0, 1].map(|i| [self.q_min[i] - self.home[i], self.q_max[i] - self.home[i]]);
        let position = |turn: [f64; 2]| [0, 1].map(|i| (self.home[i] + turn[i]).max(self.q_min[i]).min(self.q_max[i]));
        let free = best_of_all(&m);
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
fn product(joints: &TwoAxes, wanted: &UnitQuaternion<f64>) -> Matrix2<f64> {
    let ([a, b], w, x) = (joints.axes, wanted.w, wanted.imag());
    Matrix2::new(w, b.dot(&x), a.dot(&x), a.cross(&b).dot(&x) - a.dot(&b) * w)
}

/// Angles of both joints for the largest product, without limits, rad.
fn best_of_all(m: &Matrix2<f64>) -> [f64; 2] {
    let (p, q) = (m.column(0), m.column(1));
    let v = half((2.0 * p.dot(&q)).atan2(p.norm_squared() - q.norm_squared()));
    [twice_angle(m * v), twice_angle(v)]
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
    /// Derives the joints of a wrist or a head. `reference`: positions of the arms' joints in the T-pose, on top of the home
    /// posture.
    pub(crate) fn two_axes(&self, joints: [usize; 2], reference: &[(usize, f64)]) -> TwoAxes {
        let mut q = self.home;
        for &(j, position) in reference {
            q[j] = position;
        }
        let limits = joints.map(|j| self.limits[j]);
        TwoAxes {
            joints,
            axes: self.axes_at(&q, joints),
            home: joints.map(|j| self.home[j]),
            q_min: limits.map(|limits| limits.q_min),
            q_max: limits.map(|limits| limits.q_max),
        }
    }
}

impl Source<'_> {
    /// The joints that turn the head, as the robot file names them.
    pub(crate) fn head(&self, names: Option<&[String; 2]>, model: &Model) -> Result<Option<TwoAxes>, RobotError> {
        let Some(names) = names else { return Ok(None) };
        self.check_names("head_joints", names.iter(), &model.joint_names[..model.body_count])?;
        let joints = names.each_ref().map(|name| model.joint_names.iter().position(|other| other == name).unwrap_or(0));
        let head = model.two_axes(joints, &[]);
        let carries = |joint: usize, body: usize| {
            std::iter::successors(Some(body), |&body| model.parent_body(body)).any(|body| body == joint + 1)
        };
        // One joint twice, or two that turn about the same axis, have no product.
        let turn = joints.iter().all(|&j| !model.prismatic[j]) && head.axes[0].cross(&head.axes[1]).norm() > 0.5;
        let mut others = model.arms.iter().map(|arm| arm.joints[0] + 1).chain([model.torso_body]);
        if !turn || !carries(joints[0], joints[1] + 1) || others.any(|body| carries(joints[0], body)) {
            let bound = "must turn about two axes, the lower joint first, and carry neither torso nor arm";
            return Err(self.value("head_joints", format!("`{}`, `{}`", names[0], names[1]), bound));
        }
        Ok(Some(head))
    }
}
