//! The cubic through two positions and velocities (Hermite).

/// Returns position, velocity and acceleration at `share` of the way between two ends. Each end is a position and
/// a velocity. The ends are `duration_s` apart.
pub(crate) fn cubic(from: [f64; 2], to: [f64; 2], duration_s: f64, share: f64) -> [f64; 3] {
    let (h, s) = (duration_s, share);
    let (d, a, b) = (to[0] - from[0], h * from[1], h * to[1]);
    let (c2, c3) = (3.0 * d - 2.0 * a - b, a + b - 2.0 * d);
    [
        from[0] + s * (a + s * (c2 + s * c3)),
        (a + s * (2.0 * c2 + s * 3.0 * c3)) / h,
        (2.0 * c2 + s * 6.0 * c3) / (h * h),
    ]
}
