//! Extrapolation of an arm's limbs beyond the newest skeleton.
//!
//! ```text
//! learnt    R(t) = exp(turn(t - t_n)) R_n
//! fading    R(t) = exp(w T (1 - exp(-(t - t_n) / T))) R_n,   w = log(R_n R_o^-1) / (t_n - t_o)
//!
//! R_n, t_n  limb rotation (torso frame) and time of the newest skeleton
//! R_o, t_o  those of an older skeleton
//! turn      learnt rotation vector after a time, rad (see `prediction`)
//! w         turning rate of the limb, rad/s
//! T         time constant with which the rate fades, s
//! ```
//!
//! The fading form serves without a learnt prediction, and until an arm has been seen for long enough. People swing and
//! reverse, so T is short, and the limb comes to rest.

use crate::prediction::{HORIZONS_S, Turns, turn, turns_at};
use nalgebra::{UnitQuaternion, Vector3};
use robot::Limbs;

/// Time constant with which the turning rate fades, s. Of 0.05, 0.07, 0.1, 0.14, 0.2 and 0.3 it has the smallest
/// mean error over 60 to 400 ms on recorded motion: `fades_deg` of `train --prediction`.
const FADE_S: f64 = 0.1;
/// Shortest time over which a turning rate is measured, ns: two frames of 60 Hz. Noise of half a degree then makes
/// 20 degrees/s.
pub(crate) const RATE_OVER_NS: i64 = 30_000_000;
/// Fastest turn of a limb that is predicted, rad/s: a fast throw. A faster turn is a glitch of the tracker.
const RATE_MAX_RAD_PER_S: f64 = 20.0;

/// Extrapolation of an arm beyond its newest skeleton.
#[derive(Clone, Copy, Debug)]
#[allow(clippy::large_enum_variant, reason = "it lies in a track, and a tick allocates nothing")]
pub enum Extrapolation {
    /// Both limbs turn at these rates, rad/s, which fade.
    Fading([Vector3<f64>; 2]),
    /// Both limbs turn as learnt.
    Learnt(Turns),
}

impl Extrapolation {
    /// Continues the motion from `before` to `newest` in `span_ns`. Without `before` the arm rests.
    pub fn fading(newest: &Limbs, before: Option<(&Limbs, i64)>) -> Self {
        let Some((before, span_ns)) = before.filter(|(_, span_ns)| *span_ns > 0) else {
            return Self::Fading([Vector3::zeros(); 2]);
        };
        let span_s = span_ns as f64 * 1e-9;
        let rate = |before, newest| (turn(before, newest) / span_s).cap_magnitude(RATE_MAX_RAD_PER_S);
        Self::Fading([rate(&before.upper, &newest.upper), rate(&before.fore, &newest.fore)])
    }

    /// Uses learnt turns. It limits them to the farthest turn of the fading form.
    pub fn learnt(turns: &Turns) -> Self {
        let mut turns = *turns;
        for (both, horizon_s) in turns.iter_mut().zip(HORIZONS_S) {
            *both = both.map(|turn| turn.cap_magnitude(RATE_MAX_RAD_PER_S * faded_s(horizon_s)));
        }
        Self::Learnt(turns)
    }

    /// Returns the limbs `ahead_ns` after the newest ones.
    pub fn at(&self, newest: &Limbs, ahead_ns: i64) -> Limbs {
        let ahead_s = ahead_ns as f64 * 1e-9;
        let [upper, fore] = match self {
            Self::Fading(rates) => rates.map(|rate| rate * faded_s(ahead_s)),
            Self::Learnt(turns) => turns_at(turns, ahead_s),
        };
        let turned = |turn, limb: &UnitQuaternion<f64>| UnitQuaternion::from_scaled_axis(turn) * limb;
        Limbs { upper: turned(upper, &newest.upper), fore: turned(fore, &newest.fore) }
    }
}

impl Default for Extrapolation {
    fn default() -> Self {
        Self::Fading([Vector3::zeros(); 2])
    }
}

/// Returns T (1 - exp(-t / T)), s: the time in which an undiminished rate turns as far as a fading one in t = `ahead_s`.
fn faded_s(ahead_s: f64) -> f64 {
    FADE_S * (1.0 - (-ahead_s / FADE_S).exp())
}
