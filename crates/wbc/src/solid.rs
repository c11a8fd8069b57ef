//! Computes closest points of a capsule's axis and a solid around the robot, and their separation along a direction.

use crate::geometry::Segment;
use nalgebra::Vector3;
use robot::Solid;

/// Returns the point of the axis that is closest to the solid, and the point of the solid closest to it.
///
/// Let a + s d be the axis in the frame of a box of half lengths h. The squared distance is f(s) = sum_i e_i^2 with e_i
/// = x_i - clamp(x_i, -h_i, h_i), and it is convex. Its slope f'(s) / 2 = sum_i e_i d_i is continuous and does not
/// fall. It is linear between the at most six places where a coordinate enters or leaves its range. These places
/// bracket its zero, and in the bracket the zero is computed exactly. The work is bounded, and nothing is allocated.
#[inline]
pub(crate) fn closest_points(axis: &Segment, solid: &Solid) -> (Vector3<f64>, Vector3<f64>) {
    match solid {
        Solid::HalfSpace { normal, offset_m } => {
            let (above_a, above_b) = (normal.dot(&axis.a) - offset_m, normal.dot(&axis.b) - offset_m);
            let (on_axis, above) = if above_a <= above_b { (axis.a, above_a) } else { (axis.b, above_b) };
            (on_axis, on_axis - normal * above)
        }
        Solid::Box { center, r, half_m } => {
            let (a, d) = (r.tr_mul(&(axis.a - center)), r.tr_mul(&(axis.b - axis.a)));
            let s = closest_to_box(&a, &d, half_m);
            let x = a + d * s;
            (axis.a + (axis.b - axis.a) * s, center + r * x.zip_map(half_m, |x, half| x.clamp(-half, half)))
        }
    }
}

fn closest_to_box(a: &Vector3<f64>, d: &Vector3<f64>, half: &Vector3<f64>) -> f64 {
    let slope = |s: f64| {
        let x = a + d * s;
        (0..3).map(|i| (x[i] - x[i].clamp(-half[i], half[i])) * d[i]).sum::<f64>()
    };
    let (mut low, mut high) = (0.0, 1.0);
    let (mut falls, mut rises) = (slope(low), slope(high));
    if falls >= 0.0 {
        return low;
    }
    if rises <= 0.0 {
        return high;
    }
    for i in 0..3 {
        for side in [-half[i], half[i]] {
            let s = (side - a[i]) / d[i];
            if s > low && s < high {
                let at = slope(s);
                (if at < 0.0 { (low, falls) = (s, at) } else { (high, rises) = (s, at) });
            }
        }
    }
    low + (high - low) * (falls / (falls - rises))
}

/// Separation of the axis from the solid along the unit direction `n`, which leads away from the solid. It is
/// min over the axis of n.x minus max over the solid of n.x. A half-space has a separation only along its own
/// normal, so that one is used.
#[inline]
pub(crate) fn separation(n: &Vector3<f64>, axis: &Segment, solid: &Solid) -> f64 {
    match solid {
        Solid::HalfSpace { normal, offset_m } => normal.dot(&axis.a).min(normal.dot(&axis.b)) - offset_m,
        Solid::Box { center, r, half_m } => {
            let support = n.dot(center) + r.tr_mul(n).abs().dot(half_m);
            n.dot(&axis.a).min(n.dot(&axis.b)) - support
        }
    }
}

/// The unit direction from the solid to the axis, and the separation along it, which is at most the distance.
/// If the axis is inside a box, returns the direction of the nearest face, and 0.
#[inline]
pub(crate) fn normal(axis: &Segment, solid: &Solid) -> (Vector3<f64>, f64) {
    let (center, r, half_m) = match solid {
        Solid::HalfSpace { normal, .. } => return (*normal, separation(normal, axis, solid)),
        Solid::Box { center, r, half_m } => (center, r, half_m),
    };
    let (on_axis, on_solid) = closest_points(axis, solid);
    let difference = on_axis - on_solid;
    let length = difference.norm();
    if length < 1e-12 {
        let x = r.tr_mul(&(on_axis - center));
        let face = (x.abs() - half_m).imax();
        return (r.column(face) * 1.0_f64.copysign(x[face]), 0.0);
    }
    let n = difference / length;
    (n, separation(&n, axis, solid))
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Rotation3;
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64;

    fn point(rng: &mut Pcg64, size: f64) -> Vector3<f64> {
        Vector3::from_fn(|_, _| rng.random_range(-size..=size))
    }

    /// Boxes that are turned or not. Axes that are points, are parallel to an edge, or begin on a face or a corner.
    fn case(rng: &mut Pcg64, n: usize) -> (Segment, Solid) {
        let r = if n.is_multiple_of(3) { Rotation3::identity() } else { Rotation3::new(point(rng, 3.0)) };
        if n.is_multiple_of(5) {
            let solid = Solid::HalfSpace { normal: r * Vector3::z(), offset_m: rng.random_range(-1.0..1.0) };
            return (Segment { a: point(rng, 1.0), b: point(rng, 1.0) }, solid);
        }
        let (center, half_m) = (point(rng, 0.5), point(rng, 0.5).abs() + Vector3::repeat(1e-3));
        let mut a = point(rng, 1.0);
        if n.is_multiple_of(7) {
            a = half_m.zip_map(&point(rng, 1.0), |half, x| if x > 0.0 { half } else { x * half });
        }
        let along = match n % 4 {
            0 => Vector3::x() * rng.random_range(-1.0..1.0) + point(rng, if n.is_multiple_of(8) { 0.0 } else { 1e-9 }),
            1 => point(rng, 1e-10),
            _ => point(rng, 1.0),
        };
        let place = |x: Vector3<f64>| center + r * x;
        (Segment { a: place(a), b: place(a + along) }, Solid::Box { center, r: r.into_inner(), half_m })
    }

    #[test]
    fn distances_match_robot_model() {
        let mut rng = Pcg64::seed_from_u64(5);
        let mut overlapping = 0;
        for n in 0..100_000 {
            let (axis, solid) = case(&mut rng, n);
            let exact = solid.segment_distance(&axis.a, &axis.b);
            let (x, y) = closest_points(&axis, &solid);
            let (direction, sep) = normal(&axis, &solid);
            assert!(((x - y).norm() - exact.abs()).abs() < 1e-9, "{n}: {} {exact} {axis:?} {solid:?}", (x - y).norm());
            assert!((direction.norm() - 1.0).abs() < 1e-9);
            // If two points are less than a micrometre apart, the direction between them consists of rounding.
            assert!(sep <= exact + 1e-12 && (sep - exact).abs() < 1e-9 || exact.abs() < 1e-6, "{n}: {sep} {exact}");
            overlapping += usize::from(exact <= 0.0);
        }
        assert!(overlapping > 1000, "{overlapping}");
    }
}
