//! Monitors of the measured robot: they turn measurements into what `engage` judges.

use messages::JOINTS;
use robot::{Frames, Model};

pub use crate::clearance::Clearance;

/// How far outside its limits a joint may be measured before it counts, rad or m: a command may rest at its limit, and
/// an encoder of 14 bits with its noise and a servo's sag lie around it. (TiaGo++ keeps 0.02 rad and more of soft margin.)
const OUTSIDE_MARGIN: f64 = 0.005;

/// What the clearance must regain above the threshold before the monitor is content again, m: ten times what the
/// encoders' noise makes of a reach of 0.9 m.
const NEAR_HYSTERESIS_M: f64 = 0.001;

/// Least distance of the checked pairs at the measured posture (rad, m); `frames` is working memory. No allocation.
pub fn measured_clearance(model: &Model, frames: &mut Frames, q_measured: &[f64; JOINTS]) -> Clearance {
    crate::clearance::clearance(model, frames, q_measured)
}

/// Whether any joint is measured outside its limits by more than noise. NaN is outside.
pub fn outside_limits(model: &Model, q_measured: &[f64; JOINTS]) -> bool {
    model.limits.iter().zip(q_measured).any(|(limits, q)| {
        let inside = *q >= limits.q_min - OUTSIDE_MARGIN && *q <= limits.q_max + OUTSIDE_MARGIN;
        !inside
    })
}

/// Largest |command - measured| of the revolute (rad) and of the prismatic joints (m). What the command is ahead of a
/// sound servo, v times its known lag (s), is no error; zero takes the plain difference. NaN stays NaN.
pub fn tracking_error(
    model: &Model,
    q_command: &[f64; JOINTS],
    v_command: &[f64; JOINTS],
    q_measured: &[f64; JOINTS],
    servo_lag_s: f64,
) -> (f64, f64) {
    let (mut angle_rad, mut length_m) = (0.0, 0.0);
    for j in 0..JOINTS {
        let error = (q_command[j] - servo_lag_s * v_command[j] - q_measured[j]).abs();
        let greatest = if model.prismatic[j] { &mut length_m } else { &mut angle_rad };
        // Unlike f64::max this keeps NaN.
        if !(error <= *greatest) {
            *greatest = error;
        }
        if error.is_nan() {
            return (f64::NAN, f64::NAN);
        }
    }
    (angle_rad, length_m)
}

/// Whether the measured posture is near a self-collision, with hysteresis. The debounce is the fault table's.
#[derive(Clone, Copy, Debug, Default)]
pub struct Near {
    near: bool,
}

impl Near {
    /// Nothing is near.
    pub const fn new() -> Self {
        Self { near: false }
    }

    /// Judges a clearance, m. NaN is near.
    pub fn update(&mut self, model: &Model, clearance_m: f64) -> bool {
        let threshold = model.d_measured_min_m + if self.near { NEAR_HYSTERESIS_M } else { 0.0 };
        self.near = !(clearance_m >= threshold);
        self.near
    }
}
