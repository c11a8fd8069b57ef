//! Surfaces of the robot's hands, forearms and head, and their distances: capsules.

use nalgebra::{UnitQuaternion, Vector3};
use robot::segment_distance;

/// Most capsules of a hand or a head that count.
pub const CAPSULES_MAX: usize = 8;

/// Slope of a torso's sides: what is beside it may be as far behind its front as twice the distance. Assumption.
const STEEP: f64 = 2.0;

/// The axis of a capsule from the middle of its part, m, and its radius, m.
pub type Capsule = ([Vector3<f64>; 2], f64);

/// The surface of a part at the reference posture, in the torso frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Surface {
    capsules: [Capsule; CAPSULES_MAX],
    len: usize,
}

impl Surface {
    /// A point.
    pub const POINT: Self = Self { capsules: [([Vector3::new(0.0, 0.0, 0.0); 2], 0.0); CAPSULES_MAX], len: 1 };

    /// Creates a surface of the first [`CAPSULES_MAX`] capsules. A point without one.
    pub fn new(capsules: impl Iterator<Item = Capsule>) -> Self {
        let mut surface = Self::POINT;
        for (i, capsule) in capsules.take(CAPSULES_MAX).enumerate() {
            (surface.capsules[i], surface.len) = (capsule, i + 1);
        }
        surface
    }

    /// Returns the surface of a left (0) or right (1) part that is turned as `turned` says for a left one.
    pub(crate) fn turned(mut self, side: usize, turned: &UnitQuaternion<f64>) -> Self {
        for (ends, _) in &mut self.capsules[..self.len] {
            *ends = ends.map(|end| on_side(side, turned * end));
        }
        self
    }

    /// Returns the surface, moved by this way, m.
    pub(crate) fn moved(mut self, by: &Vector3<f64>) -> Self {
        for (ends, _) in &mut self.capsules[..self.len] {
            *ends = ends.map(|end| end + by);
        }
        self
    }

    /// Returns how far it is before a torso, m, if its middle is at `at`: the least x - front + STEEP max(0, |y| - side).
    fn before_m(&self, at: &Vector3<f64>, [front_m, side_m]: &[f64; 2]) -> f64 {
        let mut least_m = f64::INFINITY;
        for ([a, b], radius_m) in &self.capsules[..self.len] {
            // Along the axis it falls and rises in straight lines, and turns at the torso's sides.
            let side = |y_m: f64| ((y_m - at.y - a.y) / (b.y - a.y)).clamp(0.0, 1.0);
            for along in [0.0, 1.0, side(*side_m), side(-side_m)].into_iter().filter(|along| along.is_finite()) {
                let on = at + a + (b - a) * along;
                least_m = least_m.min(on.x + STEEP * (on.y.abs() - side_m).max(0.0) - radius_m - front_m);
            }
        }
        least_m
    }

    /// Returns the distance of both surfaces, m, if the middle of `other` is at `to` from the middle of this one. Below zero
    /// they intersect.
    pub(crate) fn gap_m(&self, other: &Self, to: &Vector3<f64>) -> f64 {
        let mut least_m = f64::INFINITY;
        for ([a, b], radius_m) in &self.capsules[..self.len] {
            for ([c, d], other_m) in &other.capsules[..other.len] {
                let apart_m = segment_distance(a, b, &(c + to), &(d + to)).distance_m;
                least_m = least_m.min(apart_m - radius_m - other_m);
            }
        }
        least_m
    }
}

/// The surfaces of an arm, from the middle of its hand.
pub(crate) struct Shape {
    /// The hand.
    pub(crate) hand: Surface,
    /// The forearm.
    pub(crate) forearm: Surface,
}

impl Shape {
    /// Returns how far each forearm is from the other arm's forearm and hand, m, if the hand of `other` is at `to` from this one.
    pub(crate) fn crossing_m(&self, other: &Self, to: &Vector3<f64>) -> f64 {
        let pairs = [(&self.forearm, &other.forearm), (&self.forearm, &other.hand), (&self.hand, &other.forearm)];
        pairs.map(|(own, other)| own.gap_m(other, to)).into_iter().fold(f64::INFINITY, f64::min)
    }

    /// Returns how far both are before a torso that reaches so far ahead and to its sides, m, if the hand is at `at`.
    pub(crate) fn before_m(&self, at: &Vector3<f64>, torso_m: &[f64; 2]) -> f64 {
        self.hand.before_m(at, torso_m).min(self.forearm.before_m(at, torso_m))
    }
}

/// Returns the vector of a left arm as that of the left (0) or the right (1) arm, and the other way round.
pub(crate) fn on_side(side: usize, v: Vector3<f64>) -> Vector3<f64> {
    if side == 0 { v } else { Vector3::new(v.x, -v.y, v.z) }
}
