//! The limits of a joint at the last hop. They decide if one state continues another. The driver, like libfranka,
//! checks again what `control` has checked, with arithmetic of its own.

use crate::acceptance::Refusal;
use crate::plan::after;

/// Rounding of a position (rad, m), a speed or an acceleration. Positions of some radians in doubles err by less than
/// 1e-11 after a stop of 7500 ticks, and the gate rounds to 1e-12.
const ROUNDING: f64 = 1e-9;

/// Share of the acceleration and jerk limits that the driver's own stops use.
/// `control` takes over such a stop on the grid of its positions, 2^-40 rad. That adds up to 0.01 rad/s^3.
const OWN_STOP_SHARE: f64 = 0.995;

/// Number of halvings of an interval. An interval of 3 rad/s or 25 rad/s^2 is then smaller than 1e-10.
const HALVINGS: usize = 40;

/// The limits of one joint. All of them are finite.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct JointLimits {
    /// Lowest position, rad or m.
    pub q_min: f64,
    /// Highest position, rad or m.
    pub q_max: f64,
    /// Highest speed, rad/s or m/s.
    pub v_max: f64,
    /// Highest acceleration, rad/s^2 or m/s^2.
    pub a_max: f64,
    /// Highest jerk, rad/s^3 or m/s^3.
    pub j_max: f64,
}

impl JointLimits {
    /// The limits of a joint that the robot does not have: it stays at zero.
    pub const ABSENT: Self = Self { q_min: 0.0, q_max: 0.0, v_max: 0.0, a_max: 1.0, j_max: 1.0 };
}

/// Position, velocity and acceleration of one joint, SI.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Point {
    pub(crate) q: f64,
    pub(crate) v: f64,
    pub(crate) a: f64,
}

impl JointLimits {
    /// Checks that `to` may follow `from` after `dt_s` seconds.
    ///
    /// A motion within the jerk limit J satisfies the following, whatever its phases
    /// (trapezoid rule, Davis and Rabinowitz, Methods of Numerical Integration, section 2.1):
    ///
    /// ```text
    /// |a - a'|                   <= J dt
    /// |v - v' - (a + a') dt / 2| <= J dt^2 / 4
    /// |q - q' - (v + v') dt / 2| <= J dt^3 / 12
    /// ```
    ///
    /// A joint that stands outside its position limits may stay there or move inward. NaN is refused.
    pub(crate) fn continues(&self, from: Point, to: Point, dt_s: f64) -> Result<(), Refusal> {
        let (q_min, q_max) = (self.q_min.min(from.q), self.q_max.max(from.q));
        let inside = to.q >= q_min - ROUNDING && to.q <= q_max + ROUNDING;
        let slow = to.v.abs() <= self.v_max + ROUNDING;
        let gentle = to.a.abs() <= self.a_max + ROUNDING;
        if !(inside && slow && gentle) {
            return Err(Refusal::OutsideLimits);
        }
        let jerk = (to.a - from.a).abs() <= self.j_max * dt_s + ROUNDING;
        let velocity = (to.v - from.v - (to.a + from.a) * dt_s / 2.0).abs();
        let position = (to.q - from.q - (to.v + from.v) * dt_s / 2.0).abs();
        let smooth = jerk
            && velocity <= self.j_max * dt_s * dt_s / 4.0 + ROUNDING
            && position <= self.j_max * dt_s * dt_s * dt_s / 12.0 + ROUNDING;
        if smooth { Ok(()) } else { Err(Refusal::Jump) }
    }

    /// Returns the position nearest to `q` inside the limits if it is at most `noise` away, and otherwise `q`. A servo
    /// may stand a little beyond a limit. A setpoint may not.
    pub(crate) fn within(&self, q: f64, noise: f64) -> f64 {
        let nearest = q.clamp(self.q_min, self.q_max);
        if (nearest - q).abs() <= noise { nearest } else { q }
    }

    /// Returns the speed nearest to `v` whose stop, [`JointLimits::stop_from`] at `braking`, ends inside the
    /// position limits.
    pub(crate) fn speed_inside(&self, q: f64, v: f64, braking: f64) -> f64 {
        let room = if v > 0.0 { self.q_max - q } else { q - self.q_min };
        let way = |speed: f64| {
            let (braking, jerks, durations_s) = self.stop_from(speed, braking);
            let phases = jerks.into_iter().zip(durations_s);
            phases.fold([0.0, speed, -braking], |now, (jerk, t)| after(now, jerk, t))[0]
        };
        let target = v.abs().min(self.v_max);
        let speed = largest(target, |speed| way(speed) <= room);
        // A speed as small as this is rounding.
        if speed <= ROUNDING { 0.0 } else { speed.copysign(v) }
    }

    /// Returns the shortest stop from speed `v` of a joint that already brakes at `braking`, both positive along the
    /// motion. It gives jerk and duration of its three phases, with [`OWN_STOP_SHARE`] of the limits A and J. It uses
    /// the braking b = min(braking, A, sqrt(2 J v)), because the jerk must end it together with the speed.
    ///
    /// ```text
    /// p  = min(A, sqrt(J v + b^2 / 2))            the strongest braking
    /// t1 = (p - b) / J,  t3 = p / J               at jerk -J and J
    /// t2 = v / p - (p^2 - b^2 / 2) / (J p)        at acceleration -p, and 0 where p is below A
    /// ```
    ///
    /// Returns b too. From a speed beyond the limit the stop takes longer, but it does not brake harder.
    pub(crate) fn stop_from(&self, v: f64, braking: f64) -> (f64, [f64; 3], [f64; 3]) {
        let (speed, a_max, jerk) = (v.abs(), OWN_STOP_SHARE * self.a_max, OWN_STOP_SHARE * self.j_max);
        if speed == 0.0 {
            return (0.0, [0.0; 3], [0.0; 3]);
        }
        let b = largest(braking.clamp(0.0, a_max), |b| b * b <= 2.0 * jerk * speed);
        let p = largest(a_max, |p| p * p <= jerk * speed + b * b / 2.0);
        let hold_s = speed / p - (p * p - b * b / 2.0) / (jerk * p);
        let duration_s = [(p - b).max(0.0) / jerk, hold_s.max(0.0), p / jerk];
        let jerk = jerk.copysign(v);
        (b, [-jerk, 0.0, jerk], duration_s)
    }
}

/// Returns the largest number from zero to `high` that `fits`, if all numbers below it fit. It tries `high`
/// itself first.
fn largest(high: f64, fits: impl Fn(f64) -> bool) -> f64 {
    if fits(high) {
        return high;
    }
    let (mut low, mut high) = (0.0, high);
    for _ in 0..HALVINGS {
        let middle = (low + high) / 2.0;
        *(if fits(middle) { &mut low } else { &mut high }) = middle;
    }
    low
}
