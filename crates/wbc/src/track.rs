//! The tracking law: the jerk that a joint wants to take.
//!
//! Let e = target - q, A the acceleration that it may use, and v_ff and a_ff the target's velocity and
//! acceleration. Then
//!
//! ```text
//! e0    = 0.55 A / 30^2
//! v_fb  = 30 e                                   for |e| <= e0
//!         sgn(e) sqrt(1.1 A (|e| - e0 / 2))      beyond: the speed from which 0.55 A stops at the target
//! a_ref = a_ff + 90 (v_ff + v_fb - v),           jerk = (a_ref - a) / h
//! ```
//!
//! Both branches meet at e0 with the same slope. Near the target the joint is a second-order system with
//! s^2 + 90 s + 2700: damping ratio 0.87.

use crate::interval::Bounds;
use crate::plan::JointState;
use messages::TICK_S;

/// Position gain near the target, 1/s. It is far below the tick rate, and enough to track smooth motion to
/// 0.3 mrad RMS (`adversarial --smooth`).
const POSITION_GAIN_PER_S: f64 = 30.0;
/// Velocity gain, 1/s. It is three times the position gain, so that the position loop does not ring.
const VELOCITY_GAIN_PER_S: f64 = 90.0;
/// Share of the acceleration that is used for the approach to a far target. The rest is for the jerk's ramps.
const APPROACH_SHARE: f64 = 0.55;

/// Below these bounds a joint counts as arrived and plays its stop, which ends in exact rest. The position
/// error (rad or m) is below the resolution of any encoder. The law itself would remove the speed and the
/// acceleration within a few ticks.
const ARRIVED_ERROR: f64 = 1e-9;
const ARRIVED_SPEED: f64 = 1e-8;
const ARRIVED_ACCELERATION: f64 = 1e-6;

/// Target that one joint follows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct JointAim {
    /// Position, rad or m.
    pub q: f64,
    /// Velocity, rad/s or m/s.
    pub dq: f64,
    /// Acceleration, rad/s^2 or m/s^2.
    pub ddq: f64,
}

impl JointAim {
    /// Returns the aim within the joint's position limits. At a limit it does not point further out. None if
    /// it is not finite.
    pub fn within(self, bounds: &Bounds) -> Option<Self> {
        if !self.q.is_finite() || !self.dq.is_finite() || !self.ddq.is_finite() {
            return None;
        }
        let q = self.q.clamp(bounds.q_min, bounds.q_max);
        let outward = (self.q - q) * self.dq > 0.0;
        Some(if outward { Self { q, dq: 0.0, ddq: 0.0 } } else { Self { q, ..self } })
    }
}

/// Wanted speed by the law, v_ff + v_fb, rad/s or m/s, within `bounds.v_max`. None if the joint has arrived
/// and its own stop brings it to exact rest.
pub fn wanted_velocity(x: JointState, aim: JointAim, bounds: &Bounds) -> Option<f64> {
    let e = aim.q - x.q;
    let arrived = e.abs() < ARRIVED_ERROR && x.v.abs() < ARRIVED_SPEED && x.a.abs() < ARRIVED_ACCELERATION;
    if arrived && aim.dq == 0.0 {
        return None;
    }
    let linear = APPROACH_SHARE * bounds.a_max / (POSITION_GAIN_PER_S * POSITION_GAIN_PER_S);
    let v_fb = if e.abs() <= linear {
        POSITION_GAIN_PER_S * e
    } else {
        (2.0 * APPROACH_SHARE * bounds.a_max * (e.abs() - linear / 2.0)).sqrt().copysign(e)
    };
    Some((aim.dq + v_fb).clamp(-bounds.v_max, bounds.v_max))
}

/// Wanted jerk towards a velocity, rad/s^3 or m/s^3, not yet limited.
pub fn wanted_jerk(x: JointState, velocity: f64, acceleration: f64, bounds: &Bounds) -> f64 {
    let a_ref = (acceleration + VELOCITY_GAIN_PER_S * (velocity - x.v)).clamp(-bounds.a_max, bounds.a_max);
    (a_ref - x.a) / TICK_S
}
