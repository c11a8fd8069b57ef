//! How the person goes on: what was seen and is not shown yet, then what is to be expected.
//!
//! Beyond the newest skeleton a limb turns on as it did last, w = log(R_n R_o^-1) / (t_n - t_o), ever less:
//!
//! ```text
//! R(t) = exp(w T (1 - exp(-(t - t_n) / T))) R_n
//! ```
//!
//! People swing and reverse: T is short, and what is far ahead counts as standing still.

use crate::arm::{Limbs, align};
use nalgebra::UnitQuaternion;

/// Time constant with which the turning rate fades, s. Chosen by `eval --prediction`: the smallest mean error at 100 ms.
const FADE_S: f64 = 0.1;
/// A turning rate is measured over at least this, ns: two frames of 60 Hz; noise of half a degree then makes 20 degrees/s.
pub(crate) const RATE_OVER_NS: i64 = 30_000_000;
/// Fastest turn of a limb that is carried on, rad/s: a fast throw; what is faster is a glitch of the tracker.
const RATE_MAX_RAD_PER_S: f64 = 20.0;

/// The limbs `ahead_ns` after the newest ones, given those `span_ns` before.
pub(crate) fn predict(newest: &Limbs, before: Option<(&Limbs, i64)>, ahead_ns: i64) -> Limbs {
    let Some((before, span_ns)) = before.filter(|(_, span_ns)| *span_ns > 0) else {
        return *newest;
    };
    let span_s = span_ns as f64 * 1e-9;
    let reach_s = FADE_S * (1.0 - (-(ahead_ns as f64) * 1e-9 / FADE_S).exp());
    let on = |newest: &UnitQuaternion<f64>, before: &UnitQuaternion<f64>| {
        let turn = (newest * align(before, newest).inverse()).scaled_axis();
        let rate = (turn / span_s).cap_magnitude(RATE_MAX_RAD_PER_S);
        UnitQuaternion::from_scaled_axis(rate * reach_s) * newest
    };
    Limbs { upper: on(&newest.upper, &before.upper), fore: on(&newest.fore, &before.fore) }
}
