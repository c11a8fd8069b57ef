//! Surfaces of the robot's hands, forearms and head, made of capsules, and their distances.
//!
//! ```text
//! gap(A, B)   = min over capsules a of A, b of B   |axis a, axis b| - r_a - r_b
//! before(A)   = min over points p of A             x - front + s max(0, |y| - side) - r
//!
//! r           radius of a capsule, m
//! front, side extent of the torso forward and to its left, m
//! s           slope of the torso's sides
//! ```
//!
//! Points are in the torso frame, m, from the middle between the shoulders.

use nalgebra::{UnitQuaternion, Vector3};
use robot::limbs::place_on_side;
use robot::segment_distance;

/// Most capsules of a surface.
pub const CAPSULES_MAX: usize = 8;

/// Slope s of the torso's sides: a point beside the torso may be twice its distance behind the front (assumption).
const SIDE_SLOPE: f64 = 2.0;

/// Ends of a capsule's axis from the middle of its part, m, and its radius, m.
pub type Capsule = ([Vector3<f64>; 2], f64);

/// The surface of a part at the reference posture, in the torso frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Surface {
    capsules: [Capsule; CAPSULES_MAX],
    len: usize,
}

impl Surface {
    /// One capsule of no extent.
    pub const POINT: Self = Self { capsules: [([Vector3::new(0.0, 0.0, 0.0); 2], 0.0); CAPSULES_MAX], len: 1 };

    /// Creates a surface of the first [`CAPSULES_MAX`] capsules. Without a capsule it is [`Surface::POINT`].
    pub fn new(capsules: impl Iterator<Item = Capsule>) -> Self {
        let mut surface = Self::POINT;
        for (i, capsule) in capsules.take(CAPSULES_MAX).enumerate() {
            (surface.capsules[i], surface.len) = (capsule, i + 1);
        }
        surface
    }

    /// Returns the surface of a left (0) or right (1) part after the rotation `turned` of a left part.
    pub(crate) fn turned(mut self, side: usize, turned: &UnitQuaternion<f64>) -> Self {
        for (ends, _) in &mut self.capsules[..self.len] {
            *ends = ends.map(|end| place_on_side(side, turned * end));
        }
        self
    }

    /// Returns the surface after a translation, m.
    pub(crate) fn moved(mut self, by: &Vector3<f64>) -> Self {
        for (ends, _) in &mut self.capsules[..self.len] {
            *ends = ends.map(|end| end + by);
        }
        self
    }

    /// Returns the distance before the torso, m, with its middle at `at`: the minimum of x - front + s max(0, |y| - side) - r.
    fn before_m(&self, at: &Vector3<f64>, [front_m, side_m]: &[f64; 2]) -> f64 {
        let mut least_m = f64::INFINITY;
        for ([a, b], radius_m) in &self.capsules[..self.len] {
            // The distance is piecewise linear along the axis. Its corners are the torso's sides.
            let side = |y_m: f64| ((y_m - at.y - a.y) / (b.y - a.y)).clamp(0.0, 1.0);
            for along in [0.0, 1.0, side(*side_m), side(-side_m)].into_iter().filter(|along| along.is_finite()) {
                let on = at + a + (b - a) * along;
                least_m = least_m.min(on.x + SIDE_SLOPE * (on.y.abs() - side_m).max(0.0) - radius_m - front_m);
            }
        }
        least_m
    }

    /// Returns the distance of both surfaces, m, with the middle of `other` at `to` from the middle of `self`. It is negative if
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

/// Surfaces of an arm, from the middle of its hand.
pub(crate) struct ArmSurfaces {
    /// The hand.
    pub(crate) hand: Surface,
    /// The forearm.
    pub(crate) forearm: Surface,
}

impl ArmSurfaces {
    /// Returns the distance of each forearm from the other arm's forearm and hand, m, with the hand of `other` at `to`.
    pub(crate) fn crossing_m(&self, other: &Self, to: &Vector3<f64>) -> f64 {
        let pairs = [(&self.forearm, &other.forearm), (&self.forearm, &other.hand), (&self.hand, &other.forearm)];
        pairs.map(|(own, other)| own.gap_m(other, to)).into_iter().fold(f64::INFINITY, f64::min)
    }

    /// Returns the distance of hand and forearm before a torso of extent `torso_m`, m, with the hand at `at`.
    pub(crate) fn before_m(&self, at: &Vector3<f64>, torso_m: &[f64; 2]) -> f64 {
        self.hand.before_m(at, torso_m).min(self.forearm.before_m(at, torso_m))
    }
}
