//! Takes wild places and the tremble out of what a camera sees, before the frame is judged.
//!
//! First a single place of a joint that is nowhere near where the joint could have gone is replaced by where it could have gone,
//! for one frame (`outlier`). Then the One-Euro filter (Casiez, Roussel, Vogel, CHI 2012) for each coordinate of each joint: a
//! low-pass of first order whose cutoff rises with the joint's speed,
//!   f_c = f_rest + g |v|,  a = 1 / (1 + 1 / (2 pi f_c T)),  y += a (x - y),
//! with the time T between two frames and a speed v that is low-passed at 1 Hz. It delays what moves slowly by
//! 1 / (2 pi f_rest), and what moves at speed v by 1 / (2 pi (f_rest + g v)).
//!
//! It hides nothing from those who judge the frame: a frame that repeats stays a repetition, a joint that jumps begins anew
//! where it jumped to, and what is no number stays none.

use crate::outlier::{Past, distance};
use messages::{RawSkeleton, SMPL_JOINTS, Stamp};
use std::f64::consts::TAU;

/// Cutoff of the speed, Hz (Casiez et al., who leave it at 1).
const SPEED_CUTOFF_HZ: f64 = 1.0;
/// After so long without a frame everything begins anew, ns: as long as several frames of the slowest camera.
const GAP_NS: u64 = 250_000_000;

/// How much is filtered.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Noise {
    /// Cutoff of what rests, f_rest, Hz.
    pub rest_cutoff_hz: f64,
    /// Hz more for each m/s, g.
    pub cutoff_per_m: f64,
    /// Deviations from where a joint could have gone beyond which its place is an outlier, k; 0 finds none.
    pub outliers_mad: f64,
    /// A joint that goes further in a 30th of a second has jumped, m.
    pub step_max_m: f64,
    /// Below this confidence a joint is not seen: that of `skeleton`.
    pub confidence_min: f32,
}

/// One coordinate: what came out last, and its speed per second.
#[derive(Clone, Copy, Debug, Default)]
struct Axis {
    value: f64,
    speed: f64,
}

/// What is remembered of one person.
#[derive(Clone, Copy, Debug)]
pub struct NoiseState {
    session: (u64, u32, u32),
    origin: Stamp,
    /// The positions that came last, and what they became.
    came: [[f32; 3]; SMPL_JOINTS],
    left: [[f32; 3]; SMPL_JOINTS],
    /// The positions that came last, less the outliers, m.
    kept: [[f64; 3]; SMPL_JOINTS],
    pasts: [Past; SMPL_JOINTS],
    axes: [[Axis; 3]; SMPL_JOINTS],
    /// Bit per joint that has a past.
    known: u32,
    rejected: u64,
}

impl NoiseState {
    /// Outliers so far, each one joint of one frame.
    pub const fn rejected(&self) -> u64 {
        self.rejected
    }
}

impl Default for NoiseState {
    fn default() -> Self {
        Self {
            session: (0, 0, 0),
            origin: Stamp::NONE,
            came: [[0.0; 3]; SMPL_JOINTS],
            left: [[0.0; 3]; SMPL_JOINTS],
            kept: [[0.0; 3]; SMPL_JOINTS],
            pasts: [Past::NONE; SMPL_JOINTS],
            axes: [[Axis::default(); 3]; SMPL_JOINTS],
            known: 0,
            rejected: 0,
        }
    }
}

/// Share of the new value that is taken, for a cutoff and a period.
fn share(cutoff_hz: f64, period_s: f64) -> f64 {
    1.0 / (1.0 + 1.0 / (TAU * cutoff_hz * period_s))
}

impl Noise {
    /// Filters the positions of a frame of SMPL-22; `layout` is the one that the client sent. Never allocates or panics,
    /// whatever the bits.
    pub fn filter(&self, state: &mut NoiseState, layout: u32, frame: &mut RawSkeleton) {
        let (origin, session) = (frame.header.origin, (frame.session_nonce, frame.operator_id, layout));
        let mut came = [[0.0; 3]; SMPL_JOINTS];
        came.copy_from_slice(&frame.positions[..SMPL_JOINTS]);
        let period_ns = origin.since(state.origin);
        if session != state.session || origin < state.origin || period_ns > GAP_NS {
            *state = NoiseState { session, rejected: state.rejected, ..NoiseState::default() };
        } else if origin == state.origin || came.as_flattened().iter().eq(state.came.as_flattened()) {
            // Not news, and to be seen as such.
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

    /// Filters the place of one joint, which is seen.
    fn see(&self, state: &mut NoiseState, joint: usize, origin: Stamp, period_s: f64, place: [f64; 3]) {
        let kept = state.kept[joint];
        // A joint that was held did not jump if it is near to where it was seen, or to where it was held.
        let step = distance(place, state.came[joint].map(f64::from)).min(distance(place, kept));
        let known = state.known & (1 << joint) != 0 && step <= self.step_max_m * (period_s * 30.0).max(1.0);
        state.known |= 1 << joint;
        if !known {
            state.pasts[joint] = Past::NONE;
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
