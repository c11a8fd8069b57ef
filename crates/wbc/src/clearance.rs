//! Distances of all checked pairs at one posture. Every certificate of a tick begins there.

use crate::chain::{BODIES, Placement, Placements};
use crate::geometry::{Geometry, Segment};
use messages::JOINTS_MAX;
use nalgebra::Vector3;

/// Pairs whose bounding spheres are farther apart than this keep the spheres' distance. A stop rarely reaches
/// that far. If one does, the certificate measures more exactly.
const FAR_M: f64 = 0.15;

/// A posture with its placements and separations.
#[derive(Clone, Debug)]
pub(crate) struct Anchor {
    pub(crate) q: [f64; JOINTS_MAX],
    pub(crate) placements: Placements,
    axes: Vec<Segment>,
    /// For each pair a lower bound of its distance, m. For near pairs it is the distance itself, except for rounding.
    pub(crate) separation: Vec<f64>,
    /// Smallest distance of all pairs, m, and the pair.
    pub(crate) clearance_m: f64,
    pub(crate) nearest: usize,
}

impl Anchor {
    pub(crate) fn new(geometry: &Geometry, q: [f64; JOINTS_MAX]) -> Self {
        let nowhere = Segment { a: Vector3::zeros(), b: Vector3::zeros() };
        let mut anchor = Self {
            q,
            placements: [Placement::identity(); BODIES],
            axes: vec![nowhere; geometry.shapes.len()],
            separation: vec![0.0; geometry.pairs.len()],
            clearance_m: f64::INFINITY,
            nearest: 0,
        };
        anchor.place(geometry, q);
        anchor
    }

    /// Moves the anchor to posture `q`.
    pub(crate) fn place(&mut self, geometry: &Geometry, q: [f64; JOINTS_MAX]) {
        self.pose(geometry, q);
        self.clearance_m = f64::INFINITY;
        for (i, pair) in geometry.pairs.iter().enumerate() {
            let (a, b) = (&self.axes[pair.a.capsule], &self.axes[pair.b.capsule]);
            let spheres = geometry.shapes[pair.a.capsule].sphere + geometry.shapes[pair.b.capsule].sphere;
            let apart = ((a.a + a.b) - (b.a + b.b)).norm() / 2.0 - spheres;
            let far = apart > FAR_M.max(self.clearance_m);
            self.separation[i] = if far { apart } else { geometry.normal(pair, a, b).1 };
            if self.separation[i] < self.clearance_m {
                (self.clearance_m, self.nearest) = (self.separation[i], i);
            }
        }
    }

    /// Moves only the kinematics to posture `q`. The separations stay as they were.
    pub(crate) fn pose(&mut self, geometry: &Geometry, q: [f64; JOINTS_MAX]) {
        self.q = q;
        geometry.chain.forward(&q, geometry.chain.all(), &mut self.placements);
        for (i, axis) in self.axes.iter_mut().enumerate() {
            *axis = geometry.axis(i, &self.placements);
        }
    }

    /// Copies `other` without allocating.
    pub(crate) fn copy_from(&mut self, other: &Self) {
        (self.q, self.placements) = (other.q, other.placements);
        self.axes.copy_from_slice(&other.axes);
        self.separation.copy_from_slice(&other.separation);
        (self.clearance_m, self.nearest) = (other.clearance_m, other.nearest);
    }

    /// Axis of joint `j` in the base frame.
    pub(crate) fn axis(&self, geometry: &Geometry, j: usize) -> Vector3<f64> {
        self.placements[j + 1].r * geometry.chain.links()[j].axis
    }

    /// Measures the distance of one pair at the posture, m, independent of its stored separation.
    pub(crate) fn measure(&self, geometry: &Geometry, pair: usize) -> f64 {
        let pair = &geometry.pairs[pair];
        geometry.normal(pair, &self.axes[pair.a.capsule], &self.axes[pair.b.capsule]).1
    }

    /// Gradient of a pair's distance by the joint positions, m per rad or m. For each joint between the
    /// bodies it is the velocity of the closest point that it carries, along the direction from B to A.
    pub(crate) fn gradient(&self, geometry: &Geometry, pair: usize) -> [f64; JOINTS_MAX] {
        let pair = &geometry.pairs[pair];
        let (a, b) = (&self.axes[pair.a.capsule], &self.axes[pair.b.capsule]);
        let (on_a, on_b) = geometry.closest_points(pair, a, b);
        let (n, _) = geometry.normal(pair, a, b);
        let carries_a = geometry.chain.ancestors(geometry.shapes[pair.a.capsule].capsule.body);
        std::array::from_fn(|j| {
            if pair.between & 1 << j == 0 {
                return 0.0;
            }
            // Only joints of the robot are between two bodies.
            let (link, placement) = (&geometry.chain.links()[j], &self.placements[j + 1]);
            let axis = placement.r * link.axis;
            let of_a = carries_a & 1 << j != 0;
            let point = if of_a { on_a } else { on_b };
            let velocity = if link.prismatic { axis } else { axis.cross(&(point - placement.t)) };
            if of_a { n.dot(&velocity) } else { -n.dot(&velocity) }
        })
    }
}
