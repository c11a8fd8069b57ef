//! Clearance of the checked pairs, with the distance formulas of `plant`.

use messages::JOINTS_MAX;
use nalgebra::Vector3;
use plant::{segment_box, segment_plane, segment_segment};
use robot::{Frames, Model, Solid};

/// The axis of a capsule in the base frame, and half its length, m.
type Axis = ([Vector3<f64>; 2], f64);

/// Buffers for the axes of all capsules, so that a tick allocates nothing.
#[derive(Clone, Debug)]
pub(crate) struct Workspace {
    frames: Frames,
    axes: Vec<Axis>,
}

impl Workspace {
    pub(crate) fn new(model: &Model) -> Self {
        Self { frames: Frames::default(), axes: Vec::with_capacity(model.capsules.len()) }
    }

    /// Returns the least clearance at posture `q`, m, and the index of its pair. It is infinite without pairs. It
    /// covers the checked pairs, and the pairs of each moving capsule with each obstacle. The latter have the
    /// indices after the pairs of capsules.
    pub(crate) fn clearance(&mut self, model: &Model, q: &[f64; JOINTS_MAX]) -> (f64, usize) {
        let Self { frames, axes } = self;
        model.forward(q, frames);
        axes.clear();
        axes.extend(model.capsules.iter().map(|capsule| (capsule.ends(frames), (capsule.b - capsule.a).norm() / 2.0)));
        let mut least = (f64::INFINITY, 0);
        for (index, pair) in model.pairs.iter().enumerate() {
            let radii_m = model.capsules[pair.a].radius_m + model.capsules[pair.b].radius_m;
            let ((a, half_a), (b, half_b)) = (&axes[pair.a], &axes[pair.b]);
            // Balls around the capsules: a pair whose balls are farther apart than the least so far cannot be nearer.
            let beyond = least.0 + half_a + half_b + radii_m;
            let between = (a[0] + a[1] - b[0] - b[1]).norm_squared() / 4.0;
            if beyond > 0.0 && between > beyond * beyond {
                continue;
            }
            let clearance = segment_segment(a, b) - radii_m;
            if clearance < least.0 {
                least = (clearance, index);
            }
        }
        for (i, ((axis, _), capsule)) in axes.iter().zip(&model.capsules).enumerate().filter(|(_, (_, c))| c.body != 0)
        {
            for (k, obstacle) in model.obstacles.iter().enumerate() {
                let clearance = from_solid(axis, &obstacle.solid) - capsule.radius_m;
                if clearance < least.0 {
                    least = (clearance, model.pairs.len() + i * model.obstacles.len() + k);
                }
            }
        }
        least
    }
}

/// Returns the distance of a segment: 0 where it touches a box, negative below a plane.
fn from_solid(segment: &[Vector3<f64>; 2], solid: &Solid) -> f64 {
    match solid {
        Solid::HalfSpace { normal, offset_m } => segment_plane(segment, normal, *offset_m),
        Solid::Box { center, r, half_m } => segment_box(&segment.map(|p| r.transpose() * (p - center)), half_m),
    }
}
