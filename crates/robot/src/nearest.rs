//! The place of an arm that is nearest to something else.

use crate::collision::Capsule;
use crate::kinematics::Frames;
use crate::model::Model;
use crate::{Solid, segment_distance};
use nalgebra::Vector3;

/// Step of a difference quotient, m: far above the rounding, far below a finger.
const STEP_M: f64 = 1e-5;

/// The place of an arm that is nearest to something else.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NearestToArm {
    /// Distance between both surfaces, m.
    pub clearance_m: f64,
    /// Place on the arm's surface, m in the base frame.
    pub from: Vector3<f64>,
    /// Unit vector from there to what is nearest, in the base frame. Zero if both overlap by so much that there is none.
    pub towards: Vector3<f64>,
}

impl Model {
    /// Returns the place of an arm, left or right, that has the smallest clearance of all checked pairs and obstacles. `None`
    /// without a checked pair. Not for a tick: it measures every pair.
    pub fn nearest_to_arm(&self, frames: &Frames, side: usize) -> Option<NearestToArm> {
        let on_arm = |capsule: &Capsule| self.arms[side].range().any(|joint| joint + 1 == capsule.body);
        let mut least: Option<NearestToArm> = None;
        let mut offer = |clearance_m: f64, on_axis: Vector3<f64>, radius_m: f64, towards: Vector3<f64>| {
            if least.is_none_or(|before| clearance_m < before.clearance_m) {
                least = Some(NearestToArm { clearance_m, from: on_axis + towards * radius_m, towards });
            }
        };
        for pair in &self.pairs {
            // The capsule that is farther out on the arm comes near the other one.
            let (own, other) = match (on_arm(&self.capsules[pair.a]), on_arm(&self.capsules[pair.b])) {
                (false, false) => continue,
                (true, false) => (&self.capsules[pair.a], &self.capsules[pair.b]),
                (_, true) => (&self.capsules[pair.b], &self.capsules[pair.a]),
            };
            let ([a, b], [c, d]) = (own.ends(frames), other.ends(frames));
            let near = segment_distance(&a, &b, &c, &d);
            let on_axis = a + (b - a) * near.s;
            let gap = c + (d - c) * near.t - on_axis;
            let towards = gap.try_normalize(1e-9).unwrap_or_default();
            offer(gap.norm() - own.radius_m - other.radius_m, on_axis, own.radius_m, towards);
        }
        for obstacle in &self.obstacles {
            for capsule in self.capsules.iter().filter(|capsule| on_arm(capsule)) {
                let [a, b] = capsule.ends(frames);
                let distance_m = obstacle.solid.segment_distance(&a, &b);
                let towards = towards(&obstacle.solid, &a, &b, distance_m);
                // The end that lies farther that way, and the middle if neither does.
                let ahead = (b - a).dot(&towards);
                let on_axis = if ahead.abs() < 1e-6 {
                    (a + b) / 2.0
                } else if ahead > 0.0 {
                    b
                } else {
                    a
                };
                offer(distance_m - capsule.radius_m, on_axis, capsule.radius_m, towards);
            }
        }
        least
    }
}

/// Direction in which a segment comes nearer to an obstacle: minus the gradient of its distance.
fn towards(solid: &Solid, a: &Vector3<f64>, b: &Vector3<f64>, distance_m: f64) -> Vector3<f64> {
    let slope = |axis: usize| {
        let step = Vector3::from_fn(|row, _| if row == axis { STEP_M } else { 0.0 });
        (distance_m - solid.segment_distance(&(a + step), &(b + step))) / STEP_M
    };
    Vector3::new(slope(0), slope(1), slope(2)).try_normalize(1e-6).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn obstacle_is_in_its_direction() {
        let plane = Solid::HalfSpace { normal: Vector3::x(), offset_m: -1.0 };
        let (a, b) = (Vector3::new(0.0, 0.1, 0.0), Vector3::new(0.1, 0.0, 0.3));
        let way = towards(&plane, &a, &b, plane.segment_distance(&a, &b));
        assert!((way + Vector3::x()).norm() < 1e-6, "{way}");
    }
}
