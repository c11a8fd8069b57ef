//! Distances of segments from segments, boxes and planes, with formulas of their own.

use nalgebra::Vector3;

type Segment = [Vector3<f64>; 2];

/// Returns the distance of two segments, m. Either may be a point.
///
/// The method is that of Ericson, Real-Time Collision Detection, section 5.1.9. Clamp the nearest point of the
/// lines to the first segment. Take the nearest point of the second, clamp that, and go back once. The nearest
/// points of nearly parallel lines are ill-conditioned, so there the function tries the ends too.
pub fn segment_segment(a: &Segment, b: &Segment) -> f64 {
    let (d1, d2, r) = (a[1] - a[0], b[1] - b[0], a[0] - b[0]);
    let (aa, ee, f) = (d1.norm_squared(), d2.norm_squared(), d2.dot(&r));
    let c = d1.dot(&r);
    let unit = |x: f64| x.clamp(0.0, 1.0);
    let (s, t) = match (aa > 0.0, ee > 0.0) {
        (false, false) => (0.0, 0.0),
        (false, true) => (0.0, unit(f / ee)),
        (true, false) => (unit(-c / aa), 0.0),
        (true, true) => {
            let along = d1.dot(&d2);
            let det = aa * ee - along * along;
            let s = if det > 0.0 { unit((along * f - c * ee) / det) } else { 0.0 };
            let t = (along * s + f) / ee;
            if t < 0.0 {
                (unit(-c / aa), 0.0)
            } else if t > 1.0 {
                (unit((along - c) / aa), 1.0)
            } else {
                (s, t)
            }
        }
    };
    let at = |s: f64, t: f64| (r + d1 * s - d2 * t).norm();
    let least = at(s, t);
    let along = d1.dot(&d2);
    // Lines at less than 0.1 mrad are nearly parallel.
    if aa * ee - along * along > 1e-8 * aa * ee {
        return least;
    }
    let on_b = |s: f64| if ee > 0.0 { unit((along * s + f) / ee) } else { 0.0 };
    let on_a = |t: f64| if aa > 0.0 { unit((along * t - c) / aa) } else { 0.0 };
    let ends = [at(0.0, on_b(0.0)), at(1.0, on_b(1.0)), at(on_a(0.0), 0.0), at(on_a(1.0), 1.0)];
    ends.into_iter().fold(least, f64::min)
}

/// Returns the distance of a segment from the half space normal . x <= offset, m. It is negative inside.
pub fn segment_plane(segment: &Segment, normal: &Vector3<f64>, offset_m: f64) -> f64 {
    normal.dot(&segment[0]).min(normal.dot(&segment[1])) - offset_m
}

/// Returns the distance of a segment, given in the box's axes about its centre, from the box |x_i| <= half_i, m.
/// Zero inside.
///
/// The squared distance along the segment is convex and a quadratic between the places where a coordinate enters or
/// leaves its range. Its derivative rises, so the minimum lies in the first piece at whose end the derivative is not
/// negative.
pub fn segment_box(segment: &Segment, half_m: &Vector3<f64>) -> f64 {
    let (from, d) = (segment[0], segment[1] - segment[0]);
    let beyond = |s: f64| (from + d * s).zip_map(half_m, |x, half| x - x.clamp(-half, half));
    let mut places = [0.0; 8];
    let mut count = 1;
    for i in 0..3 {
        for side in [-half_m[i], half_m[i]] {
            let s = (side - from[i]) / d[i];
            // NaN and infinity, for a coordinate that does not change, fail this test.
            if s > 0.0 && s < 1.0 {
                places[count] = s;
                count += 1;
            }
        }
    }
    places[count] = 1.0;
    places[..=count].sort_unstable_by(f64::total_cmp);
    for piece in places[..=count].windows(2) {
        let (s0, s1) = (piece[0], piece[1]);
        let slope = |s: f64| beyond(s).dot(&d);
        let (low, high) = (slope(s0), slope(s1));
        if low >= 0.0 {
            return beyond(s0).norm();
        }
        if high >= 0.0 {
            // The derivative is linear within a piece.
            return beyond(s0 + (s1 - s0) * low / (low - high)).norm();
        }
    }
    beyond(1.0).norm()
}
