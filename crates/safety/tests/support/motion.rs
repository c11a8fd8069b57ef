//! Motions for the gate in plain `f64`: proposals, and a judge that shares no code with the gate.

use messages::{JOINTS, StopPlan};
use robot::JointLimits;
use safety::engage::Permit;
use safety::gate::Proposed;

pub const T: f64 = 1.0 / 1500.0;

/// Position, velocity, acceleration.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Joint {
    pub q: f64,
    pub v: f64,
    pub a: f64,
}

impl Joint {
    pub fn after(self, j: f64, t: f64) -> Self {
        Self {
            q: self.q + self.v * t + self.a * t * t / 2.0 + j * t * t * t / 6.0,
            v: self.v + self.a * t + j * t * t / 2.0,
            a: self.a + j * t,
        }
    }
}

/// Three phases: jerk and duration.
pub type Stop = [(f64, f64); 3];

/// A stop from (v, a). It brings the acceleration to -s p, holds it, and brings it to zero. s is the sign of
/// the velocity that coasting would leave. p is found by bisection and not by a formula.
pub fn stop_from(x: Joint, a_max: f64, j_max: f64) -> Stop {
    let coast = x.v + x.a * x.a.abs() / (2.0 * j_max);
    let s = if coast < 0.0 { -1.0 } else { 1.0 };
    let (v, a) = (s * x.v, s * x.a);
    // Velocity that remains if the acceleration goes straight to -p and straight back.
    let ramp = |p: f64| (-p - a).abs() / j_max;
    let left = |p: f64| v + (a - p) / 2.0 * ramp(p) - p * p / (2.0 * j_max);
    let (mut low, mut high) = ((-a).max(0.0).min(a_max), a_max);
    if left(a_max) < 0.0 {
        for _ in 0..80 {
            let middle = (low + high) / 2.0;
            if left(middle) > 0.0 { low = middle } else { high = middle }
        }
    } else {
        low = a_max;
    }
    let p = low;
    let cruise = if p > 0.0 { (left(p) / p).max(0.0) } else { 0.0 };
    let first = if -p < a { -j_max } else { j_max };
    [(s * first, ramp(p)), (0.0, cruise), (s * j_max, p / j_max)]
}

pub fn store(plan: &mut StopPlan, j: usize, stop: &Stop) {
    for (i, (jerk, duration)) in stop.iter().enumerate() {
        plan.jerk[j][i] = *jerk;
        plan.duration_s[j][i] = *duration;
    }
}

pub fn stop_of(plan: &StopPlan, j: usize) -> Stop {
    std::array::from_fn(|i| (plan.jerk[j][i], plan.duration_s[j][i]))
}

/// Returns `x` after time `t` of the stop. After its end the joint is at rest.
pub fn play(mut x: Joint, stop: &Stop, t: f64) -> Joint {
    let mut left = t;
    for (jerk, duration) in stop {
        let dt = left.min(*duration);
        x = x.after(*jerk, dt);
        left -= dt;
    }
    // The end itself is at rest by definition. The gate's clock errs by 1e-15 s per tick.
    let over = t >= stop.iter().map(|(_, duration)| duration).sum::<f64>() - 1e-12;
    if over { Joint { v: 0.0, a: 0.0, ..x } } else { x }
}

pub const NO_PLAN: StopPlan = StopPlan { jerk: [[0.0; 3]; JOINTS], duration_s: [[0.0; 3]; JOINTS] };

pub fn resting(k: u64, q: [f64; JOINTS]) -> Proposed {
    let permit = Permit::Follow { speed_scale: 1.0 };
    Proposed { k, permit, q, v: [0.0; JOINTS], a: [0.0; JOINTS], plan: NO_PLAN }
}

pub fn joint(p: &Proposed, j: usize) -> Joint {
    Joint { q: p.q[j], v: p.v[j], a: p.a[j] }
}

pub fn set_joint(p: &mut Proposed, j: usize, x: Joint) {
    (p.q[j], p.v[j], p.a[j]) = (x.q, x.v, x.a);
}

/// Slack of the judge for rounding, SI. It is above the gate's own slack of 5.8e-11 and far below any motion.
pub const GRANTED: f64 = 1e-9;

/// Instants inside (0, t) at which c + b t + a t^2 / 2 is zero.
fn zeros(c: f64, b: f64, a: f64, t: f64) -> impl Iterator<Item = f64> {
    let both = if a == 0.0 {
        [-c / b, f64::NAN]
    } else {
        let root = (b * b - 2.0 * a * c).sqrt();
        [(-b - root) / a, (-b + root) / a]
    };
    both.into_iter().filter(move |at| *at > 0.0 && *at < t)
}

/// The first limit that a phase of constant jerk breaks by more than `grant`. Its turning points are computed
/// in closed form.
fn broken(l: &JointLimits, start: Joint, jerk: f64, t: f64, grant: f64) -> Option<&'static str> {
    let turns = zeros(start.a, jerk, 0.0, t).chain(zeros(start.v, start.a, jerk, t)).chain([0.0, t]);
    let mut found = None;
    for x in turns.map(|at| start.after(jerk, at)) {
        let what = if x.v.abs() > l.v_max + grant {
            "velocity"
        } else if x.q < l.q_min - grant || x.q > l.q_max + grant {
            "position"
        } else if x.a.abs() > l.a_max + grant {
            "acceleration"
        } else {
            continue;
        };
        found = found.or(Some(what));
    }
    found
}

fn near(x: Joint, y: Joint, grant: f64) -> bool {
    (x.q - y.q).abs() <= grant && (x.v - y.v).abs() <= grant && (x.a - y.a).abs() <= grant
}

/// The first error in a joint's step from `last` (whose stop was `stop_before`) to `next` with `stop`, up to
/// `grant`.
pub fn wrong(
    l: &JointLimits,
    last: Joint,
    stop_before: &Stop,
    next: Joint,
    stop: &Stop,
    grant: f64,
) -> Option<&'static str> {
    let finite = [next.q, next.v, next.a].iter().chain(stop.iter().flat_map(|(j, d)| [j, d])).all(|x| x.is_finite());
    if !finite {
        return Some("not finite");
    }
    let jerk = (next.a - last.a) / T;
    // The 1e-13 is the rounding of `f64` itself.
    if near(play(last, stop_before, T), next, grant + 1e-13) {
        let mut x = last;
        let mut left = T;
        for (jerk, duration) in stop_before {
            let t = left.min(*duration);
            if let Some(what) = broken(l, x, *jerk, t, grant) {
                return Some(what);
            }
            x = x.after(*jerk, t);
            left -= t;
        }
    } else if jerk.abs() > l.j_max + grant / T {
        return Some("jerk");
    } else if !near(last.after(jerk, T), next, grant + 1e-13) {
        return Some("step");
    } else if let Some(what) = broken(l, last, jerk, T, grant) {
        return Some(what);
    }
    let mut x = next;
    for (jerk, duration) in stop {
        if *duration < 0.0 || *duration > 0.0 && jerk.abs() > l.j_max + grant / T {
            return Some("plan's jerk or time");
        }
        if let Some(what) = broken(l, x, *jerk, *duration, grant) {
            return Some(match what {
                "velocity" => "plan's velocity",
                "position" => "plan's position",
                _ => "plan's acceleration",
            });
        }
        x = x.after(*jerk, *duration);
    }
    if x.v.abs() > 1e-6 || x.a.abs() > 1e-6 {
        return Some("no rest at the plan's end");
    }
    (stop.iter().map(|(_, duration)| duration).sum::<f64>() > 10.0).then_some("endless plan")
}
