//! Distance of two line segments, which are the axes of two capsules.

use nalgebra::Vector3;

/// Closest points of the segments a0 + s (a1 - a0) and b0 + t (b1 - b0).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SegmentDistance {
    /// Their distance, m.
    pub distance_m: f64,
    /// Position on the first segment, 0 to 1.
    pub s: f64,
    /// Position on the second segment, 0 to 1.
    pub t: f64,
}

/// Distance of two segments, m, with the parameters of the closest points. Either segment may be a point.
/// Never allocates.
///
/// |r + s d1 - t d2|^2 is convex in (s, t). If the stationary point lies inside the unit square, it is the
/// minimum. Otherwise the minimum is on one of the four edges. All five are tried and the least is taken. For
/// nearly parallel axes the stationary point is ill-conditioned. But even then the result is never more than
/// that of an end point.
pub fn segment_distance(a0: &Vector3<f64>, a1: &Vector3<f64>, b0: &Vector3<f64>, b1: &Vector3<f64>) -> SegmentDistance {
    let d1 = a1 - a0;
    let d2 = b1 - b0;
    let r = a0 - b0;
    let (a, b, e) = (d1.norm_squared(), d1.dot(&d2), d2.norm_squared());
    let (c, f) = (d1.dot(&r), d2.dot(&r));

    // The best place on one segment for a fixed place on the other. A point has only place 0.
    let best_t = |s: f64| {
        if e > 0.0 { ((b * s + f) / e).clamp(0.0, 1.0) } else { 0.0 }
    };
    let best_s = |t: f64| {
        if a > 0.0 { ((b * t - c) / a).clamp(0.0, 1.0) } else { 0.0 }
    };
    let squared = |s: f64, t: f64| (r + d1 * s - d2 * t).norm_squared();

    let edges = [(0.0, best_t(0.0)), (1.0, best_t(1.0)), (best_s(0.0), 0.0), (best_s(1.0), 1.0)];
    let (mut s, mut t) = edges[0];
    let mut least = squared(s, t);
    let mut consider = |at: (f64, f64)| {
        let value = squared(at.0, at.1);
        if value < least {
            (least, s, t) = (value, at.0, at.1);
        }
    };
    edges[1..].iter().copied().for_each(&mut consider);
    let determinant = a * e - b * b;
    if determinant > 0.0 {
        let inside = ((b * f - c * e) / determinant).clamp(0.0, 1.0);
        consider((inside, best_t(inside)));
    }
    SegmentDistance { distance_m: least.sqrt(), s, t }
}
