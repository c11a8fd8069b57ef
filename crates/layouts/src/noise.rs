//! Filters outliers and noise out of camera data before the frame is judged.
//!
//! First, an outlier of a single joint is replaced by a predicted position, for one frame (`outlier`). Then the
//! One-Euro filter (Casiez, Roussel, Vogel, CHI 2012) smooths each coordinate of each joint. It is a low-pass of
//! first order whose cutoff rises with the joint's speed:
//!
//! ```text
//! f_c = f_rest + g |v|,  a = 1 / (1 + 1 / (2 pi f_c T)),  y += a (x - y)
//! ```
//!
//! T is the time between two frames, and v is a speed that is low-passed at 1 Hz. The filter delays slow motion by
//! 1 / (2 pi f_rest), and motion at speed v by 1 / (2 pi (f_rest + g v)).
//!
//! It hides no error from the validation. A repeated frame stays a repetition. For a joint that jumps the filter
//! restarts at the new position. NaN stays NaN.

use crate::outlier::{Past, distance};
use messages::{RawSkeleton, SMPL_JOINTS, Stamp};
use std::f64::consts::TAU;

/// Cutoff of the speed, Hz. Casiez et al. keep it at 1.
const SPEED_CUTOFF_HZ: f64 = 1.0;
/// Time without a frame after which the filter restarts, ns: several frames of the slowest camera.
const GAP_NS: u64 = 250_000_000;

/// Settings of the filter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Noise {
    /// Cutoff at rest, f_rest, Hz.
    pub rest_cutoff_hz: f64,
    /// Growth of the cutoff with the speed, g, Hz per m/s.
    pub cutoff_per_m: f64,
    /// Threshold k for outliers, in deviations from the predicted position. 0 finds none.
    pub outliers_mad: f64,
    /// Largest motion of a joint in a 30th of a second, m. A longer one is a jump.
    pub step_max_m: f64,
    /// Smallest confidence of a visible joint, as in `skeleton`.
    pub confidence_min: f32,
}

/// One coordinate: the last output, and its speed per second.
#[derive(Clone, Copy, Debug, Default)]
struct Axis {
    value: f64,
    speed: f64,
}

/// State for one person.
#[derive(Clone, Copy, Debug, Default)]
pub struct NoiseState {
    session: (u64, u32, u32),
    origin: Stamp,
    /// The last input positions, and their filtered values.
    came: [[f32; 3]; SMPL_JOINTS],
    left: [[f32; 3]; SMPL_JOINTS],
    /// The last input positions, with outliers replaced, m.
    kept: [[f64; 3]; SMPL_JOINTS],
    pasts: [Past; SMPL_JOINTS],
    axes: [[Axis; 3]; SMPL_JOINTS],
    /// Bit per joint that has a past.
    known: u32,
    rejected: u64,
}

impl NoiseState {
    /// Number of outliers so far. Each one is one joint of one frame.
    pub const fn rejected(&self) -> u64 {
        self.rejected
    }
}

/// Weight of the new value, for a cutoff and a period.
fn share(cutoff_hz: f64, period_s: f64) -> f64 {
    1.0 / (1.0 + 1.0 / (TAU * cutoff_hz * period_s))
}

impl Noise {
    /// Filters the positions of a frame of SMPL-22. `layout` is the one that the client sent. Never allocates or
    /// panics, whatever the bits.
    pub fn filter(&self, state: &mut NoiseState, layout: u32, frame: &mut RawSkeleton) {
        let (origin, session) = (frame.header.origin, (frame.session_nonce, frame.operator_id, layout));
        let mut came = [[0.0; 3]; SMPL_JOINTS];
        came.copy_from_slice(&frame.positions[..SMPL_JOINTS]);
        let period_ns = origin.since(state.origin);
        if session != state.session || origin < state.origin || period_ns > GAP_NS {
            *state = NoiseState { session, rejected: state.rejected, ..NoiseState::default() };
        } else if origin == state.origin || came.as_flattened().iter().eq(state.came.as_flattened()) {
            // A repeated frame stays visible as a repetition.
            frame.positions[..SMPL_JOINTS].copy_from_slice(&state.left);
            state.origin = origin;
            return;
        }
        let period_s = period_ns as f64 * 1e-9;
        for (joint, place) in came.iter().enumerate() {
            state.left[joint] = *place;
            if frame.confidence[joint] >= self.confidence_min && place.iter().all(|x| x.is_finite()) {
                self.see(state, joint, origin, period_s, place.map(f64::from));
            } else {
                state.known &= !(1 << joint);
            }
        }
        (state.origin, state.came) = (origin, came);
        frame.positions[..SMPL_JOINTS].copy_from_slice(&state.left);
    }

    /// Filters the position of one visible joint.
    fn see(&self, state: &mut NoiseState, joint: usize, origin: Stamp, period_s: f64, place: [f64; 3]) {
        let kept = state.kept[joint];
        // A held joint did not jump if it is near its last input position, or near the position at which it was held.
        let step = distance(place, state.came[joint].map(f64::from)).min(distance(place, kept));
        let known = state.known & (1 << joint) != 0 && step <= self.step_max_m * (period_s * 30.0).max(1.0);
        state.known |= 1 << joint;
        if !known {
            state.pasts[joint] = Past::default();
            state.axes[joint] = place.map(|value| Axis { value, speed: 0.0 });
        }
        let held =
            if self.outliers_mad > 0.0 { state.pasts[joint].hold(self.outliers_mad, origin, place) } else { None };
        state.rejected = state.rejected.saturating_add(u64::from(held.is_some()));
        state.kept[joint] = held.unwrap_or(place);
        if !known {
            return;
        }
        for (i, axis) in state.axes[joint].iter_mut().enumerate() {
            let value = state.kept[joint][i];
            axis.speed += share(SPEED_CUTOFF_HZ, period_s) * ((value - kept[i]) / period_s - axis.speed);
            let cutoff_hz = self.rest_cutoff_hz + self.cutoff_per_m * axis.speed.abs();
            axis.value += share(cutoff_hz, period_s) * (value - axis.value);
            state.left[joint][i] = axis.value as f32;
        }
    }
}
