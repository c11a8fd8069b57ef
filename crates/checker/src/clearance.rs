//! Clearance of the checked pairs, with distance formulas of its own.

use nalgebra::Vector3;
use plant::Apart;
use robot::{Capsule, Frames, Model, Solid};

type Segment = [Vector3<f64>; 2];

/// The collision model as this crate keeps it.
#[derive(Clone, Debug)]
pub(crate) struct Body {
    capsules: Vec<Capsule>,
    pairs: Vec<Pair>,
    obstacles: Vec<Solid>,
    /// Clearance that every pair must keep, m.
    pub(crate) d_min_m: f64,
}

#[derive(Clone, Copy, Debug)]
struct Pair {
    a: usize,
    b: usize,
    radii_m: f64,
}

/// Buffers for the capsules' axes in the base frame, so that a tick allocates nothing.
#[derive(Clone, Debug)]
pub(crate) struct Workspace {
    frames: Frames,
    axes: Vec<Segment>,
    before: Vec<Segment>,
    apart: Apart,
}

impl Body {
    pub(crate) fn new(model: &Model) -> Self {
        let radii = |a: usize, b: usize| model.capsules[a].radius_m + model.capsules[b].radius_m;
        let pairs = model.pairs.iter().map(|pair| Pair { a: pair.a, b: pair.b, radii_m: radii(pair.a, pair.b) });
        let obstacles = model.obstacles.iter().map(|obstacle| obstacle.solid).collect();
        Self { capsules: model.capsules.clone(), pairs: pairs.collect(), obstacles, d_min_m: model.d_min_m }
    }

    pub(crate) fn workspace(&self) -> Workspace {
        let axes = vec![[Vector3::zeros(); 2]; self.capsules.len()];
        let apart = Apart::new(axes.len(), self.pairs.len());
        Workspace { frames: Frames::default(), before: axes.clone(), axes, apart }
    }

    /// Returns the least clearance at posture `q`, m, and the index of its pair. It is infinite without pairs. It
    /// covers the checked pairs, and the pairs of each moving capsule with each obstacle. The latter have the
    /// indices after the pairs of capsules.
    pub(crate) fn clearance(
        &self,
        model: &Model,
        q: &[f64; messages::JOINTS_MAX],
        workspace: &mut Workspace,
    ) -> (f64, usize) {
        let Workspace { frames, axes, before, apart } = workspace;
        model.forward(q, frames);
        std::mem::swap(axes, before);
        for (axis, capsule) in axes.iter_mut().zip(&self.capsules) {
            *axis = capsule.ends(frames);
        }
        let moves = before.iter().zip(axes.iter());
        apart.look(moves.map(|(from, to)| [0, 1].map(|end| (to[end] - from[end]).norm_squared())));
        let mut least = (f64::INFINITY, 0);
        if let Some(pair) = self.pairs.get(apart.nearest) {
            let clearance = distance(&axes[pair.a], &axes[pair.b]) - pair.radii_m;
            // NaN is no least clearance.
            least = (least.0.min(clearance), apart.nearest);
        }
        for (index, pair) in self.pairs.iter().enumerate() {
            let sides = [pair.a, pair.b];
            if apart.is_beyond(index, sides, least.0) {
                continue;
            }
            let clearance = distance(&axes[pair.a], &axes[pair.b]) - pair.radii_m;
            apart.set(index, sides, clearance);
            if clearance < least.0 || (clearance == least.0 && index < least.1) {
                least = (clearance, index);
            }
        }
        apart.nearest = least.1;
        for (i, (axis, capsule)) in axes.iter().zip(&self.capsules).enumerate().filter(|(_, (_, c))| c.body != 0) {
            for (k, obstacle) in self.obstacles.iter().enumerate() {
                let clearance = from_solid(axis, obstacle) - capsule.radius_m;
                if clearance < least.0 {
                    least = (clearance, self.pairs.len() + i * self.obstacles.len() + k);
                }
            }
        }
        least
    }
}

/// Returns the distance of a segment from an obstacle: 0 where it touches a box, negative below a plane.
fn from_solid(segment: &Segment, solid: &Solid) -> f64 {
    match solid {
        Solid::HalfSpace { normal, offset_m } => normal.dot(&segment[0]).min(normal.dot(&segment[1])) - offset_m,
        Solid::Box { center, r, half_m } => from_box(&segment.map(|p| r.tr_mul(&(p - center))), half_m),
    }
}

/// Returns the distance of a segment from the box |x_i| <= half_i.
///
/// A coordinate is below, within or above its range, so there are 26 ways of being outside. For each of them the
/// squared distance is a quadratic in the place s on the segment: the sum of (x_i -+ half_i)^2 over the coordinates
/// outside. Its minimum is known. The true minimum is at one of these minima, at an end, or at a place where a
/// coordinate enters or leaves its range. The function takes the distance at all of these places and returns the least.
fn from_box(segment: &Segment, half: &Vector3<f64>) -> f64 {
    let (a, d) = (segment[0], segment[1] - segment[0]);
    let squared_at = |s: f64| {
        let s = if s > 0.0 { s.min(1.0) } else { 0.0 };
        Vector3::from_fn(|i, _| ((a[i] + s * d[i]).abs() - half[i]).max(0.0)).norm_squared()
    };
    let mut least = squared_at(0.0).min(squared_at(1.0));
    for way in 1..27 {
        let sides = [1, 3, 9].map(|power| [0.0, -1.0, 1.0][way / power % 3]);
        let (mut falls, mut curves) = (0.0, 0.0);
        for i in (0..3).filter(|&i| sides[i] != 0.0) {
            falls += d[i] * (sides[i] * half[i] - a[i]);
            curves += d[i] * d[i];
        }
        // With one coordinate outside, this is the place where it enters its range.
        if curves > 0.0 {
            least = least.min(squared_at(falls / curves));
        }
    }
    least.sqrt()
}

/// Returns the distance of two segments. Either an end of one is nearest, or both nearest points lie inside, and
/// then the vector between them is perpendicular to both. The least of the five candidates is the distance,
/// parallel segments included.
fn distance(a: &Segment, b: &Segment) -> f64 {
    let mut least = from_point(&a[0], b).min(from_point(&a[1], b)).min(from_point(&b[0], a)).min(from_point(&b[1], a));
    let (u, w, r) = (a[1] - a[0], b[1] - b[0], a[0] - b[0]);
    let (uu, uw, ww, ur, wr) = (u.dot(&u), u.dot(&w), w.dot(&w), u.dot(&r), w.dot(&r));
    let denominator = uu * ww - uw * uw;
    if denominator > 0.0 {
        let s = (uw * wr - ww * ur) / denominator;
        let t = (uu * wr - uw * ur) / denominator;
        if (0.0..=1.0).contains(&s) && (0.0..=1.0).contains(&t) {
            least = least.min((r + u * s - w * t).norm_squared());
        }
    }
    least.sqrt()
}

/// Returns the squared distance of a point from a segment.
fn from_point(p: &Vector3<f64>, segment: &Segment) -> f64 {
    let (d, r) = (segment[1] - segment[0], p - segment[0]);
    let dd = d.norm_squared();
    let t = if dd > 0.0 { (d.dot(&r) / dd).clamp(0.0, 1.0) } else { 0.0 };
    (r - d * t).norm_squared()
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};

    #[test]
    fn distances_from_solids_match_robot_model() {
        let mut rng = rand_pcg::Pcg64::seed_from_u64(6);
        let mut point = |size: f64| -> [f64; 3] { std::array::from_fn(|_| rng.random_range(-size..=size)) };
        let mut touching = 0;
        for n in 0..100_000 {
            let half_m = point(0.5).map(|x| x.abs() + 1e-3);
            let mut a = point(1.0);
            // Some segments begin in the plane of a face, some are points, some are almost parallel to an edge.
            if n % 5 == 0 {
                a[n % 3] = half_m[n % 3];
            }
            let mut d = point(if n % 4 == 1 { 1e-10 } else { 1.0 });
            if n % 4 == 0 {
                (d[1], d[2]) = (d[1] * 1e-9, if n % 8 == 0 { 0.0 } else { d[2] * 1e-9 });
            }
            let (center, turn) = (point(0.5), point(3.0));
            let pose = robot::Pose::from_xyz_rpy(center, if n % 3 == 0 { [0.0; 3] } else { turn });
            let place = |p: [f64; 3]| pose.transform_point(&p.into());
            let (from, to) = (place(a), place(std::array::from_fn(|i| a[i] + d[i])));
            let z = pose.r.column(2).into_owned();
            let solids = [
                Solid::Box { center: pose.t, r: pose.r, half_m: half_m.into() },
                Solid::HalfSpace { normal: z, offset_m: 0.3 * center[0] },
            ];
            for solid in solids {
                let own = from_solid(&[from, to], &solid);
                let other = solid.segment_distance(&from, &to);
                assert!((own - other).abs() < 1e-9, "{n}: {own} {other} {from} {to} {solid:?}");
                touching += usize::from(own == 0.0);
            }
        }
        assert!(touching > 1000, "{touching}");
    }

    #[test]
    fn segment_distances_match_known_geometry() {
        let x = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]];
        let crossing_above = [[0.5, -1.0, 0.3], [0.5, 1.0, 0.3]];
        let parallel = [[0.5, 0.2, 0.0], [3.0, 0.2, 0.0]];
        let beyond_the_end = [[4.0, 4.0, 0.0], [4.0, 8.0, 0.0]];
        let point = [[0.25, 0.0, 0.7]; 2];
        for (other, expected) in [(crossing_above, 0.3), (parallel, 0.2), (beyond_the_end, 5.0), (point, 0.7), (x, 0.0)]
        {
            let [x, other] = [x, other].map(|segment| segment.map(Vector3::from));
            assert!((distance(&x, &other) - expected).abs() < 1e-12, "{other:?}: {}", distance(&x, &other));
            assert!((distance(&other, &x) - expected).abs() < 1e-12);
        }
    }
}
