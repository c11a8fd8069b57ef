//! The person's way: the measured part that is not shown yet, then the predicted part.
//!
//! Beyond the newest skeleton, at t_n, a limb turns as learnt from recorded motion (see `prediction`):
//!
//! ```text
//! R(t) = exp(turn(t - t_n)) R_n
//! ```
//!
//! Without a learnt prediction, and until an arm has been seen for long enough, a limb continues its last turn. Its rate
//! w = log(R_n R_o^-1) / (t_n - t_o) fades:
//!
//! ```text
//! R(t) = exp(w T (1 - exp(-(t - t_n) / T))) R_n
//! ```
//!
//! People swing and reverse. So T is short, and far ahead the limb stands still.

use crate::arm::Limbs;
use crate::prediction::{HORIZONS_S, Turns, turn, turns_at};
use nalgebra::{UnitQuaternion, Vector3};

/// Time constant with which the turning rate fades, s. Of 0.05, 0.07, 0.1, 0.14, 0.2 and 0.3 it has the smallest
/// mean error over 60 to 400 ms on recorded motion: `fades_deg` of `train --prediction`.
const FADE_S: f64 = 0.1;
/// Shortest time over which a turning rate is measured, ns: two frames of 60 Hz. Noise of half a degree then makes
/// 20 degrees/s.
pub(crate) const RATE_OVER_NS: i64 = 30_000_000;
/// Fastest turn of a limb that is predicted, rad/s: a fast throw. A faster turn is a glitch of the tracker.
const RATE_MAX_RAD_PER_S: f64 = 20.0;

/// Prediction of an arm beyond its newest skeleton.
#[derive(Clone, Copy, Debug)]
#[allow(clippy::large_enum_variant, reason = "it lies in a track, and a tick allocates nothing")]
pub enum Expected {
    /// Both limbs continue at these rates, rad/s, which fade.
    Fading([Vector3<f64>; 2]),
    /// Both limbs turn as learnt.
    Learnt(Turns),
}

impl Expected {
    /// Continues the motion from `before` to `newest` in `span_ns`. Without these the arm stands still.
    pub fn fading(newest: &Limbs, before: Option<(&Limbs, i64)>) -> Self {
        let Some((before, span_ns)) = before.filter(|(_, span_ns)| *span_ns > 0) else {
            return Self::Fading([Vector3::zeros(); 2]);
        };
        let span_s = span_ns as f64 * 1e-9;
        let rate = |before, newest| (turn(before, newest) / span_s).cap_magnitude(RATE_MAX_RAD_PER_S);
        Self::Fading([rate(&before.upper, &newest.upper), rate(&before.fore, &newest.fore)])
    }

    /// Uses learnt turns. They are limited to the farthest turn of a fading limb.
    pub fn learnt(turns: &Turns) -> Self {
        let mut turns = *turns;
        for (both, horizon_s) in turns.iter_mut().zip(HORIZONS_S) {
            *both = both.map(|turn| turn.cap_magnitude(RATE_MAX_RAD_PER_S * reach_s(horizon_s)));
        }
        Self::Learnt(turns)
    }

    /// Returns the limbs `ahead_ns` after the newest ones.
    pub fn at(&self, newest: &Limbs, ahead_ns: i64) -> Limbs {
        let ahead_s = ahead_ns as f64 * 1e-9;
        let [upper, fore] = match self {
            Self::Fading(rates) => rates.map(|rate| rate * reach_s(ahead_s)),
            Self::Learnt(turns) => turns_at(turns, ahead_s),
        };
        let on = |turn, limb: &UnitQuaternion<f64>| UnitQuaternion::from_scaled_axis(turn) * limb;
        Limbs { upper: on(upper, &newest.upper), fore: on(fore, &newest.fore) }
    }
}

impl Default for Expected {
    fn default() -> Self {
        Self::Fading([Vector3::zeros(); 2])
    }
}

/// Time for which a turn at full speed goes as far as a fading one in `ahead_s`.
fn reach_s(ahead_s: f64) -> f64 {
    FADE_S * (1.0 - (-ahead_s / FADE_S).exp())
}
