//! The ease curve s^2 (3 - 2 s).

/// Rises from 0 at the first of two places to 1 at the second, with a continuous slope.
pub(crate) fn smoothstep(at: f64, [zero, one]: [f64; 2]) -> f64 {
    let s = ((at - zero) / (one - zero)).clamp(0.0, 1.0);
    s * s * (3.0 - 2.0 * s)
}
