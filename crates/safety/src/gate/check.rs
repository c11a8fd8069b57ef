//! The checks of one joint.

use messages::JOINTS_MAX;
use robot::JointLimits;
use thiserror::Error;

use super::fixed::{
    ACCELERATION_CEILING, Extremes, JERK_CEILING, MOTION_CEILING, Phase, Point, TICK, TIME_UNITS, UNITS, quantise,
};
use super::stop::Stop;
use super::stored::Phases;

/// Rounding that every comparison allows, in units: 5.8e-11 rad, rad/s, rad/s^2. Positions rounded to the
/// nearest unit and three phases of integration err by less than 8 units
/// (`integration_matches_polynomial`). The rest is for sender and driver, which compute in `f64`.
pub(super) const SLACK: i64 = 64;

/// Velocity and acceleration that may remain when a plan ends, in units.
///
/// It is 1e-7 rad/s and rad/s^2, as in the driver, minus the rounding above. So the driver accepts every plan
/// that passes here. The joint is then at rest by definition. The time-optimal stops of a million random
/// states leave at most 2 units (`honest_stop_leaves_under_a_thousandth_of_rest_slack`).
const REST_SLACK: i64 = 109_951 - SLACK;

/// Rounding of the jerk, in units of jerk. The jerk is judged by the change of acceleration over a tick, and
/// both ends are rounded.
const JERK_SLACK: i64 = 1500 * SLACK;

/// A check that a joint's command fails.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Check {
    /// A value is NaN, infinite or beyond the ceilings of the arithmetic, or a duration is negative.
    Finite,
    /// The command leaves the position limits, at its tick or on the way to it.
    Position,
    /// The command leaves the velocity limits, at its tick or on the way to it.
    Velocity,
    /// The command leaves the acceleration limits.
    Acceleration,
    /// The command needs more jerk than allowed.
    Jerk,
    /// The command is neither one tick of constant jerk after the last one, nor the next point of the stored plan.
    Step,
    /// The command is faster than the permit allows.
    SpeedScale,
    /// The plan leaves the limits on its way.
    PlanLimits,
    /// The plan does not end at rest, or ends later than any stop has to.
    Braking,
    /// The robot has no such joint, and a value of it is not zero.
    Absent,
}

/// Returned for limits that the gate cannot work with. Numbers are SI.
#[derive(Clone, Debug, PartialEq, Error)]
#[allow(missing_docs, reason = "the texts name the fields")]
pub enum ConfigError {
    /// Returned if a limit is not finite, not positive, or too large for the arithmetic.
    #[error("joint {joint}: {limit} = {value}, must lie in ({min}, {max}]")]
    Limit { joint: String, limit: &'static str, value: f64, min: f64, max: f64 },
    /// Returned if the least clearance is not finite and positive, so that nothing would be kept apart.
    #[error("clearance_min = {0} m, must be finite and above zero")]
    Clearance(f64),
    /// Returned if the bound on the speed of hands is not finite and positive, so that no motion would be left.
    #[error("hand speed = {0} m/s, must be finite and above zero")]
    HandSpeed(f64),
    /// Returned if a figure of the interface is outside its bound.
    #[error("interface: {key} = {value}, must be 0 to {bound}")]
    Interface { key: &'static str, value: f64, bound: f64 },
    /// Returned if the collision model has too many pairs or capsules.
    #[error("collision model: {value} pairs, at most {bound}")]
    Pairs {
        /// Number of pairs of two capsules, or of a capsule and an obstacle.
        value: usize,
        bound: usize,
    },
}

/// The limits of one joint in units.
#[derive(Clone, Copy, Debug)]
pub(super) struct Limits {
    pub(super) q: [i64; 2],
    pub(super) v: i64,
    pub(super) a: i64,
    pub(super) jerk: i64,
    /// Longest stop that the gate accepts, in units of time.
    pub(super) stop: i64,
}

/// Margin on the stop time. A plan that uses a little less than the limits takes a little longer.
const STOP_TIME_MARGIN: f64 = 1.05;

impl Limits {
    /// `latest_s` is a lower bound of the allowed stop time, s. Where the motors have little to spare, a stop
    /// brakes more gently.
    pub(super) fn new(name: &str, limits: &JointLimits, latest_s: f64) -> Result<Self, ConfigError> {
        let units = |limit: &'static str, value: f64, min: f64, max: f64| {
            let inside = value > min && value <= max;
            let refused = || ConfigError::Limit { joint: name.to_owned(), limit, value, min, max };
            quantise(value, max, UNITS).filter(|_| inside).ok_or_else(refused)
        };
        let q_min = units("q_min", limits.q_min, -MOTION_CEILING, MOTION_CEILING)?;
        let q_max = units("q_max", limits.q_max, limits.q_min, MOTION_CEILING)?;
        let v = units("v_max", limits.v_max, 0.0, MOTION_CEILING)?;
        let a = units("a_max", limits.a_max, 0.0, ACCELERATION_CEILING)?;
        let jerk = units("j_max", limits.j_max, 0.0, JERK_CEILING)?;
        // This is no shorter than any time-optimal stop from (v, a) with v + a^2 / 2J <= V and |a| <= A. Such
        // a stop takes at most V/A + 2 A/J. Losing the acceleration takes A/J, and the stop from the highest
        // speed takes V/A + A/J. If A is never reached, the latter is 2 sqrt(V/J), which is less.
        let stop_s = limits.v_max / limits.a_max + 2.0 * limits.a_max / limits.j_max;
        // The conversion saturates. With any positive limits the bound can only grow.
        let stop = (stop_s.max(latest_s) * STOP_TIME_MARGIN * TIME_UNITS) as i64;
        Ok(Self { q: [q_min, q_max], v, a, jerk, stop: stop.saturating_add(TICK) })
    }

    /// Returns the limits for a tick of recovery. If the joint is outside, the range reaches to its last
    /// position, without slack, so that it cannot creep outwards. The largest speed is `v`.
    pub(super) fn recovering(&self, last: Point, v: i64) -> Self {
        let q = [self.q[0].min(last.q + SLACK), self.q[1].max(last.q - SLACK)];
        Self { q, v: self.v.min(v), ..*self }
    }

    fn holds_position(&self, q: [i64; 2]) -> bool {
        q[0] >= self.q[0] - SLACK && q[1] <= self.q[1] + SLACK
    }

    fn holds_velocity(&self, v: [i64; 2]) -> bool {
        v[0] >= -self.v - SLACK && v[1] <= self.v + SLACK
    }

    fn within(&self, extremes: &Extremes) -> Result<(), Check> {
        if !self.holds_velocity(extremes.v) {
            return Err(Check::Velocity);
        }
        if !self.holds_position(extremes.q) {
            return Err(Check::Position);
        }
        Ok(())
    }

    /// Checks the step from `last` to `next`. `on_plan` is the point of the stored plan for this tick.
    pub(super) fn step(&self, last: Point, next: Point, on_plan: Point) -> Result<(), Check> {
        if next.a.abs() > self.a + SLACK {
            return Err(Check::Acceleration);
        }
        self.within(&Extremes { q: [next.q; 2], v: [next.v; 2] })?;
        if next.is_near(on_plan, SLACK) {
            // The point and the way to it were checked when the plan was accepted.
            return Ok(());
        }
        // |a| is at most 2^52 on both sides, so the product may reach 2^53 * 1500 > 2^63. It is computed in i128.
        // It fits an i64 once it is known to be within the jerk limit.
        let jerk = i128::from(next.a - last.a) * 1500;
        if jerk.abs() > i128::from(self.jerk + JERK_SLACK) {
            return Err(Check::Jerk);
        }
        if !next.is_near(last.reaching(next.a, TICK), SLACK) {
            return Err(Check::Step);
        }
        let (_, extremes) = Phase { jerk: jerk as i64, duration: TICK }.play(last);
        self.within(&extremes)
    }

    /// Checks the speed in a tick with only part of the velocity limit. It may not exceed that part, or the previous
    /// speed, if that is greater. The stored plan is always allowed, because it brakes as soon as the joint can.
    pub(super) fn slow(&self, last: Point, next: Point, on_plan: Point, speed_scale: f64) -> Result<(), Check> {
        if speed_scale >= 1.0 {
            return Ok(());
        }
        // NaN becomes zero too, so nothing may get faster.
        let share = (speed_scale.max(0.0) * self.v as f64) as i64;
        let slower = next.v.abs() <= share.max(last.v.abs()) + SLACK || next.is_near(on_plan, SLACK);
        if slower { Ok(()) } else { Err(Check::SpeedScale) }
    }

    /// Checks the stop from `start`.
    pub(super) fn stop(&self, start: Point, phases: &Phases) -> Result<Stop, Check> {
        if phases.iter().map(|phase| phase.duration).sum::<i64>() > self.stop {
            return Err(Check::Braking);
        }
        let mut stop = Stop::new(start, phases);
        for (i, phase) in phases.iter().enumerate().filter(|(_, phase)| phase.duration > 0) {
            if phase.jerk.abs() > self.jerk + SLACK {
                return Err(Check::PlanLimits);
            }
            let (end, extremes) = phase.play(stop.end());
            if end.a.abs() > self.a + SLACK || self.within(&extremes).is_err() {
                return Err(Check::PlanLimits);
            }
            stop.record(i, end, &extremes);
        }
        at_rest(stop.end()).then_some(stop).ok_or(Check::Braking)
    }
}

fn at_rest(point: Point) -> bool {
    point.v.abs() <= REST_SLACK && point.a.abs() <= REST_SLACK
}

/// Returns true if a stop ends at rest, at any position. The gate requires only this of a state that the
/// driver is already in.
pub(super) fn comes_to_rest(start: Point, phases: &Phases) -> bool {
    at_rest(phases.iter().fold(start, |point, phase| point.after(phase.jerk, phase.duration)))
}

/// Largest differences between two plans that count as the same: 0.1 ns, and the jerk that rounding of a sum leaves.
const SAME_DURATION: i64 = 1 << 15;
const SAME_JERK: i64 = 1 << 20;

/// Returns true if two stops are the same up to rounding. Phases without duration do not count.
pub(super) fn same_stop(x: &Phases, y: &Phases) -> bool {
    let mut x = x.iter().filter(|phase| phase.duration > SAME_DURATION);
    let mut y = y.iter().filter(|phase| phase.duration > SAME_DURATION);
    loop {
        match (x.next(), y.next()) {
            (None, None) => return true,
            (Some(x), Some(y)) => {
                let same = (x.duration - y.duration).abs() <= SAME_DURATION && (x.jerk - y.jerk).abs() <= SAME_JERK;
                if !same {
                    return false;
                }
            }
            (None, Some(_)) | (Some(_), None) => return false,
        }
    }
}

/// Converts the limits of all joints.
pub(super) fn all_limits(
    names: &[String],
    limits: &[JointLimits; JOINTS_MAX],
    latest_s: f64,
) -> Result<[Limits; JOINTS_MAX], ConfigError> {
    let mut out = [Limits { q: [0; 2], v: 0, a: 0, jerk: 0, stop: 0 }; JOINTS_MAX];
    for (j, name) in names.iter().enumerate() {
        out[j] = Limits::new(name, &limits[j], latest_s)?;
    }
    Ok(out)
}
