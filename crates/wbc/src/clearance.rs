//! Distances of all checked pairs at one posture: where every certificate of a tick begins.

use crate::chain::{BODIES, Placement, Placements};
use crate::geometry::{Geometry, Segment, normal};
use messages::JOINTS;
use nalgebra::Vector3;

/// Pairs farther apart than this by their bounding spheres keep the spheres' distance: no stop reaches that far often, and
/// where one does, the certificate looks closer.
const FAR_M: f64 = 0.3;

/// A posture with its placements and separations.
#[derive(Clone, Debug)]
pub(crate) struct Anchor {
    pub(crate) q: [f64; JOINTS],
    pub(crate) placements: Placements,
    axes: Vec<Segment>,
    /// For each pair a lower bound of its distance, m; the distance itself but for rounding where it is near.
    pub(crate) separation: Vec<f64>,
    /// Smallest distance of all pairs, m, and the pair.
    pub(crate) clearance_m: f64,
    pub(crate) nearest: usize,
}

impl Anchor {
    pub(crate) fn new(geometry: &Geometry, q: [f64; JOINTS]) -> Self {
        let nowhere = Segment {
            a: Vector3::zeros(),
            b: Vector3::zeros(),
        };
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
    pub(crate) fn place(&mut self, geometry: &Geometry, q: [f64; JOINTS]) {
        self.q = q;
        geometry.chain.forward(&q, (1 << JOINTS) - 1, &mut self.placements);
        for (i, axis) in self.axes.iter_mut().enumerate() {
            *axis = geometry.axis(i, &self.placements);
        }
        self.clearance_m = f64::INFINITY;
        for (i, pair) in geometry.pairs.iter().enumerate() {
            let (a, b) = (&self.axes[pair.a.capsule], &self.axes[pair.b.capsule]);
            let spheres = geometry.shapes[pair.a.capsule].sphere + geometry.shapes[pair.b.capsule].sphere;
            let apart = ((a.a + a.b) - (b.a + b.b)).norm() / 2.0 - spheres;
            let far = apart > FAR_M.max(self.clearance_m);
            self.separation[i] = if far { apart } else { normal(a, b).1 - pair.radii };
            if self.separation[i] < self.clearance_m {
                (self.clearance_m, self.nearest) = (self.separation[i], i);
            }
        }
    }
}
