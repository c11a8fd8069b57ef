//! The two joints of a wrist or a head that come nearest to a rotation, in closed form.
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

use crate::arm::{rotation_from_xyzw, rotation_of_arm, slerp};
use messages::{Skeleton, skeleton_flag};
use nalgebra::{Matrix2, UnitQuaternion, Vector2};
use robot::TwoAxes;
use std::f64::consts::{PI, TAU};

/// Time in which a hand or a head that is seen again gets its full turn, and in which a lost one loses it, s. Half a turn
/// then is as fast as a quick hand (assumption).
const BLEND_S: f64 = 1.0;

/// A turn that comes and goes without a step.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Blend {
    turn: UnitQuaternion<f64>,
    weight: f64,
}

impl Default for Blend {
    fn default() -> Self {
        Self { turn: UnitQuaternion::identity(), weight: 0.0 }
    }
}

impl Blend {
    /// Returns the turn to take after `elapsed_s`. `None` once a lost one is gone.
    pub(crate) fn next(&mut self, seen: Option<UnitQuaternion<f64>>, elapsed_s: f64) -> Option<UnitQuaternion<f64>> {
        let share = elapsed_s / BLEND_S;
        self.weight = (self.weight + if seen.is_some() { share } else { -share }).clamp(0.0, 1.0);
        self.turn = seen.unwrap_or(self.turn);
        (self.weight > 0.0).then(|| slerp(&UnitQuaternion::identity(), &self.turn, self.weight))
    }
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
/// let [pan, tilt] = retarget::pointed(&head, &to_the_left);
/// assert!((pan - 0.3).abs() < 1e-9 && tilt.abs() < 1e-9);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn pointed(joints: &TwoAxes, wanted: &UnitQuaternion<f64>) -> [f64; 2] {
    let m = product(joints, wanted);
    let bounds = [0, 1].map(|i| [joints.q_min[i] - joints.home[i], joints.q_max[i] - joints.home[i]]);
    let position =
        |turn: [f64; 2]| [0, 1].map(|i| (joints.home[i] + turn[i]).max(joints.q_min[i]).min(joints.q_max[i]));
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

/// Returns the hand of one arm as that of a left arm. `None` if it is not marked valid or is no rotation.
pub(crate) fn human_hand(skeleton: &Skeleton, arm: usize) -> Option<UnitQuaternion<f64>> {
    let valid = skeleton.flags & skeleton_flag::HAND[arm] != 0;
    valid.then(|| rotation_of_arm(arm, skeleton.hands[arm].map(f64::from))).flatten()
}

/// Returns the head. `None` if it is not marked valid or is no rotation.
pub(crate) fn human_head(skeleton: &Skeleton) -> Option<UnitQuaternion<f64>> {
    let valid = skeleton.flags & skeleton_flag::HEAD != 0;
    valid.then(|| rotation_from_xyzw(skeleton.head.map(f64::from))).flatten()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn turn_comes_and_goes_over_a_second_without_a_step() {
        let (mut blend, seen) = (Blend::default(), UnitQuaternion::from_euler_angles(0.0, 1.0, 0.0));
        let (mut before, mut gone) = (UnitQuaternion::identity(), None);
        for k in 0..300 {
            let next = blend.next((k < 150).then_some(seen), 0.01);
            let now = next.unwrap_or_default();
            let step = now.angle_to(&before);
            assert!(step <= 0.01 + 1e-9, "step {k}: {step} rad");
            assert!(!(100..150).contains(&k) || now.angle_to(&seen) < 1e-6, "step {k}: it is not whole");
            gone = gone.or((next.is_none()).then_some(k));
            before = now;
        }
        assert!(gone.is_some_and(|k| (249..=251).contains(&k)), "gone at step {gone:?}");
    }
}
