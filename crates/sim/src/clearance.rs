//! Clearance of the checked pairs, with distances of its own.

use robot::{Frames, Model};

type Point = [f64; 3];

/// The collision model as this crate keeps it.
#[derive(Clone, Debug)]
pub(crate) struct Body {
    capsules: Vec<Capsule>,
    pairs: Vec<Pair>,
    /// Clearance that every pair must keep, m.
    pub(crate) d_min_m: f64,
}

#[derive(Clone, Debug)]
struct Capsule {
    body: usize,
    ends: [Point; 2],
    half_length_m: f64,
}

#[derive(Clone, Copy, Debug)]
struct Pair {
    a: usize,
    b: usize,
    radii_m: f64,
}

/// Room for the capsules' axes in the base frame, so that a tick allocates nothing.
#[derive(Clone, Debug)]
pub(crate) struct Workspace {
    frames: Frames,
    axes: Vec<[Point; 2]>,
}

impl Body {
    pub(crate) fn new(model: &Model) -> Self {
        let capsules = model.capsules.iter().map(|capsule| {
            let ends = [&capsule.a, &capsule.b].map(|p| [p[0], p[1], p[2]]);
            Capsule { body: capsule.body, ends, half_length_m: length(minus(ends[1], ends[0])) / 2.0 }
        });
        let radii = |a: usize, b: usize| model.capsules[a].radius_m + model.capsules[b].radius_m;
        let pairs = model.pairs.iter().map(|pair| Pair { a: pair.a, b: pair.b, radii_m: radii(pair.a, pair.b) });
        Self { capsules: capsules.collect(), pairs: pairs.collect(), d_min_m: model.d_min_m }
    }

    pub(crate) fn workspace(&self) -> Workspace {
        Workspace { frames: Frames::default(), axes: vec![[[0.0; 3]; 2]; self.capsules.len()] }
    }

    /// The least clearance of the checked pairs at posture `q`, m, and the index of that pair; infinite without pairs.
    pub(crate) fn clearance(&self, model: &Model, q: &[f64; messages::JOINTS], room: &mut Workspace) -> (f64, usize) {
        model.forward(q, &mut room.frames);
        for (axis, capsule) in room.axes.iter_mut().zip(&self.capsules) {
            let pose = &room.frames.base_from_body[capsule.body];
            for (out, p) in axis.iter_mut().zip(&capsule.ends) {
                *out = std::array::from_fn(|row| {
                    pose.r[(row, 0)] * p[0] + pose.r[(row, 1)] * p[1] + pose.r[(row, 2)] * p[2] + pose.t[row]
                });
            }
        }
        let mut least = (f64::INFINITY, 0);
        for (index, pair) in self.pairs.iter().enumerate() {
            let (a, b) = (&room.axes[pair.a], &room.axes[pair.b]);
            // Balls around the capsules: no pair whose balls are farther apart than the least so far can be nearer.
            let reach = self.capsules[pair.a].half_length_m + self.capsules[pair.b].half_length_m + pair.radii_m;
            let beyond = least.0 + reach;
            let between = squared(minus(middle(a), middle(b)));
            if beyond > 0.0 && between > beyond * beyond {
                continue;
            }
            let clearance = distance(a, b) - pair.radii_m;
            if clearance < least.0 {
                least = (clearance, index);
            }
        }
        least
    }
}

/// Distance of two segments. Either an end of one is nearest, or both nearest points lie inside, and then the vector
/// between them is perpendicular to both: the least of the five candidates is the distance, parallel segments included.
fn distance(a: &[Point; 2], b: &[Point; 2]) -> f64 {
    let mut least = from_point(a[0], b).min(from_point(a[1], b)).min(from_point(b[0], a)).min(from_point(b[1], a));
    let (u, w, r) = (minus(a[1], a[0]), minus(b[1], b[0]), minus(a[0], b[0]));
    let (uu, uw, ww, ur, wr) = (dot(u, u), dot(u, w), dot(w, w), dot(u, r), dot(w, r));
    let denominator = uu * ww - uw * uw;
    if denominator > 0.0 {
        let s = (uw * wr - ww * ur) / denominator;
        let t = (uu * wr - uw * ur) / denominator;
        if (0.0..=1.0).contains(&s) && (0.0..=1.0).contains(&t) {
            let between: Point = std::array::from_fn(|i| r[i] + s * u[i] - t * w[i]);
            least = least.min(squared(between));
        }
    }
    least.sqrt()
}

/// Squared distance of a point from a segment.
fn from_point(p: Point, segment: &[Point; 2]) -> f64 {
    let (d, r) = (minus(segment[1], segment[0]), minus(p, segment[0]));
    let dd = squared(d);
    let t = if dd > 0.0 { (dot(d, r) / dd).clamp(0.0, 1.0) } else { 0.0 };
    squared(std::array::from_fn(|i| r[i] - t * d[i]))
}

fn minus(a: Point, b: Point) -> Point {
    std::array::from_fn(|i| a[i] - b[i])
}

fn middle(axis: &[Point; 2]) -> Point {
    std::array::from_fn(|i| (axis[0][i] + axis[1][i]) / 2.0)
}

fn dot(a: Point, b: Point) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn squared(a: Point) -> f64 {
    dot(a, a)
}

fn length(a: Point) -> f64 {
    squared(a).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distances_known_from_geometry() {
        let x = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]];
        let crossing_above = [[0.5, -1.0, 0.3], [0.5, 1.0, 0.3]];
        let parallel = [[0.5, 0.2, 0.0], [3.0, 0.2, 0.0]];
        let beyond_the_end = [[4.0, 4.0, 0.0], [4.0, 8.0, 0.0]];
        let point = [[0.25, 0.0, 0.7]; 2];
        for (other, expected) in [(crossing_above, 0.3), (parallel, 0.2), (beyond_the_end, 5.0), (point, 0.7), (x, 0.0)]
        {
            assert!((distance(&x, &other) - expected).abs() < 1e-12, "{other:?}: {}", distance(&x, &other));
            assert!((distance(&other, &x) - expected).abs() < 1e-12);
        }
    }
}
