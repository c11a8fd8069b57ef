//! The points of the arms whose speed is bounded.

use crate::model::Model;
use nalgebra::Vector3;

/// A point that is fixed to a body.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SpeedPoint {
    /// The body. Body 1 + j moves with joint j.
    pub body: usize,
    /// The point in the body's frame, m.
    pub at: Vector3<f64>,
}

impl Model {
    /// Elbow and hand of the left arm, then of the right one. The elbow is the beginning of the forearm, at
    /// the origin of its last joint. The hand is an end of a capsule on the last joint's body, the one
    /// farthest from that joint's origin. This is the end of a finger. Without such a capsule it is the
    /// origin itself.
    pub fn speed_points(&self) -> [SpeedPoint; 4] {
        let [left, right] = self.arms.each_ref().map(|arm| {
            let ([_, fore], last) = (arm.limb_bodies(), arm.hand_body());
            let ends = self.capsules.iter().filter(|capsule| capsule.body == last).flat_map(|c| [c.a, c.b]);
            let hand = ends.max_by(|a, b| a.norm().total_cmp(&b.norm())).unwrap_or_default();
            [SpeedPoint { body: fore, at: Vector3::zeros() }, SpeedPoint { body: last, at: hand }]
        });
        [left[0], left[1], right[0], right[1]]
    }
}
