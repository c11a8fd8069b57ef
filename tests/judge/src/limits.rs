//! The limits that one joint's motion breaks. Turning points are computed in closed form. Every test asks if a limit
//! holds, so NaN breaks it.

use crate::joint::{Joint, Stop, duration_s};
use checker::ViolationKind;
use messages::TICK_S;
use robot::JointLimits;

/// A broken limit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Breach {
    /// The limit. A motion off constant jerk and off the plan counts as jerk.
    pub kind: ViolationKind,
    /// The limit in words.
    pub what: &'static str,
}

const fn breach(kind: ViolationKind, what: &'static str) -> Option<Breach> {
    Some(Breach { kind, what })
}

/// Slack for rounding, SI.
#[derive(Clone, Copy, Debug)]
pub struct Slack {
    /// Slack of positions, velocities and accelerations within their limits.
    pub state: f64,
    /// Slack of jerks.
    pub jerk: f64,
    /// Distance of positions, velocities and accelerations from those that constant jerk or the plan gives.
    pub step: f64,
    /// Velocity and acceleration that may be left at the end of a plan.
    pub rest: f64,
}

impl Slack {
    /// Returns the slack for states that are off by up to `grant`. `f64` itself rounds by 1e-13.
    pub fn for_grant(grant: f64) -> Self {
        Self { state: grant, jerk: grant / TICK_S, step: grant + 1e-13, rest: 1e-6 }
    }
}

/// Longest stop, s.
const STOP_MAX_S: f64 = 10.0;

/// Instants inside (0, t) at which c + b t + a t^2 / 2 is zero. Both roots keep their digits where `a` is nearly zero:
/// with w = -(b + sign(b) sqrt(b^2 - 2 a c)) they are w / a and 2 c / w.
fn zeros(c: f64, b: f64, a: f64, t: f64) -> impl Iterator<Item = f64> {
    let w = -(b + (b * b - 2.0 * a * c).sqrt().copysign(b));
    [w / a, 2.0 * c / w].into_iter().filter(move |at| *at > 0.0 && *at < t)
}

/// The first limit of a state that a phase of constant jerk breaks.
fn phase(l: &JointLimits, start: Joint, jerk: f64, t: f64, slack: f64) -> Option<Breach> {
    let turns = zeros(start.a, jerk, 0.0, t).chain(zeros(start.v, start.a, jerk, t)).chain([0.0, t]);
    turns.map(|at| start.after(jerk, at)).find_map(|x| {
        let slow = x.v.abs() <= l.v_max + slack;
        let inside = x.q >= l.q_min - slack && x.q <= l.q_max + slack;
        let gentle = x.a.abs() <= l.a_max + slack;
        match (slow, inside, gentle) {
            (false, _, _) => breach(ViolationKind::Velocity, "velocity"),
            (_, false, _) => breach(ViolationKind::Position, "position"),
            (_, _, false) => breach(ViolationKind::Acceleration, "acceleration"),
            _ => None,
        }
    })
}

/// Judges a tick from `last` to `next` along the stop of `last`.
pub fn along_plan(l: &JointLimits, mut last: Joint, stop: &Stop, next: Joint, slack: Slack) -> Option<Breach> {
    if !last.play(stop, TICK_S).is_near(next, slack.step) {
        return breach(ViolationKind::Jerk, "step");
    }
    let mut left = TICK_S;
    stop.iter().find_map(|(jerk, duration)| {
        let t = left.min(*duration);
        let found = phase(l, last, *jerk, t, slack.state);
        last = last.after(*jerk, t);
        left -= t;
        found
    })
}

/// Judges a tick of constant jerk from `last` to `next`.
pub fn by_jerk(l: &JointLimits, last: Joint, next: Joint, slack: Slack) -> Option<Breach> {
    let jerk = (next.a - last.a) / TICK_S;
    let smooth = jerk.abs() <= l.j_max + slack.jerk;
    if !smooth {
        breach(ViolationKind::Jerk, "jerk")
    } else if !last.after(jerk, TICK_S).is_near(next, slack.step) {
        breach(ViolationKind::Jerk, "step")
    } else {
        phase(l, last, jerk, TICK_S, slack.state)
    }
}

/// Judges a whole stop from `x`.
pub fn plan(l: &JointLimits, mut x: Joint, stop: &Stop, slack: Slack) -> Option<Breach> {
    for (jerk, duration) in stop {
        let smooth = *duration == 0.0 || *duration > 0.0 && jerk.abs() <= l.j_max + slack.jerk;
        if !smooth {
            return breach(ViolationKind::Jerk, "plan's jerk or time");
        }
        if let Some(found) = phase(l, x, *jerk, *duration, slack.state) {
            let what = match found.kind {
                ViolationKind::Velocity => "plan's velocity",
                ViolationKind::Position => "plan's position",
                _ => "plan's acceleration",
            };
            return Some(Breach { what, ..found });
        }
        x = x.after(*jerk, *duration);
    }
    let rests = x.v.abs() <= slack.rest && x.a.abs() <= slack.rest;
    if !rests {
        return breach(ViolationKind::Jerk, "no rest at the plan's end");
    }
    if duration_s(stop) <= STOP_MAX_S { None } else { breach(ViolationKind::Jerk, "endless plan") }
}

/// Returns the first breach of a joint's tick from `last` (whose stop was `stop_before`) to `next`, and of the stop
/// after it. The tick is one of constant jerk, or one of the plan.
pub fn tick(
    l: &JointLimits,
    last: Joint,
    stop_before: &Stop,
    next: Joint,
    stop: &Stop,
    slack: Slack,
) -> Option<Breach> {
    let planned = last.play(stop_before, TICK_S).is_near(next, slack.step);
    let step = if planned { along_plan(l, last, stop_before, next, slack) } else { by_jerk(l, last, next, slack) };
    step.or_else(|| plan(l, next, stop, slack))
}
