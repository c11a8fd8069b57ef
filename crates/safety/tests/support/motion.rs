//! Motions for the gate, in plain `f64`: proposals, and a judge that shares no line with the gate.

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

/// A stop from (v, a): bring the acceleration to -s p, hold it, bring it to zero, with s the sign of the velocity that
/// coasting would leave, found by bisection of p instead of a formula.
pub fn stop_from(x: Joint, a_max: f64, j_max: f64) -> Stop {
    let coast = x.v + x.a * x.a.abs() / (2.0 * j_max);
    let s = if coast < 0.0 { -1.0 } else { 1.0 };
    let (v, a) = (s * x.v, s * x.a);
    // Velocity that is left when the acceleration goes straight to -p and straight back.
    let ramp = |p: f64| (-p - a).abs() / j_max;
    let left = |p: f64| v + (a - p) / 2.0 * ramp(p) - p * p / (2.0 * j_max);
    let (mut low, mut high) = ((-a).max(0.0).min(a_max), a_max);
    if left(a_max) < 0.0 {
        for _ in 0..200 {
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

/// `x` after `t` of the stop, at rest after its end.
pub fn play(mut x: Joint, stop: &Stop, t: f64) -> Joint {
    let mut left = t;
    for (jerk, duration) in stop {
        let dt = left.min(*duration);
        x = x.after(*jerk, dt);
        left -= dt;
    }
    if left > 0.0 { Joint { v: 0.0, a: 0.0, ..x } } else { x }
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

/// What the judge grants for rounding, SI: above the gate's own slack of 5.8e-11 and far below anything that moves.
pub const GRANTED: f64 = 1e-9;

/// The first thing that is wrong with a joint's step from `last` (whose stop was `stop_before`) to `next` with `stop`,
/// found by walking through all of it in `f64` at 1/16 of a tick.
pub fn wrong(l: &JointLimits, last: Joint, stop_before: &Stop, next: Joint, stop: &Stop) -> Option<&'static str> {
    let finite = [next.q, next.v, next.a].iter().chain(stop.iter().flat_map(|(j, d)| [j, d])).all(|x| x.is_finite());
    if !finite {
        return Some("not finite");
    }
    let bad = |x: Joint| {
        if x.q < l.q_min - GRANTED || x.q > l.q_max + GRANTED {
            Some("position")
        } else if x.v.abs() > l.v_max + GRANTED {
            Some("velocity")
        } else {
            (x.a.abs() > l.a_max + GRANTED).then_some("acceleration")
        }
    };
    let near = |x: Joint, y: Joint| {
        (x.q - y.q).abs() < GRANTED && (x.v - y.v).abs() < GRANTED && (x.a - y.a).abs() < GRANTED
    };
    let jerk = (next.a - last.a) / T;
    let constant = jerk.abs() <= l.j_max + 1e-6 && near(last.after(jerk, T), next);
    let planned = near(play(last, stop_before, T), next);
    if !constant && !planned {
        return Some("step");
    }
    for n in 1..=16 {
        let t = T * f64::from(n) / 16.0;
        let at = if planned { play(last, stop_before, t) } else { last.after(jerk, t) };
        if let Some(what) = bad(at) {
            return Some(what);
        }
    }
    if stop.iter().any(|(jerk, duration)| *duration < 0.0 || *duration > 0.0 && jerk.abs() > l.j_max + 1e-6) {
        return Some("jerk of the plan");
    }
    let total: f64 = stop.iter().map(|(_, duration)| duration).sum();
    let mut x = next;
    for (jerk, duration) in stop {
        for n in 1..=8 {
            if let Some(what) = bad(x.after(*jerk, duration * f64::from(n) / 8.0)) {
                return Some(what);
            }
        }
        x = x.after(*jerk, *duration);
    }
    if x.v.abs() > 1e-6 || x.a.abs() > 1e-6 {
        return Some("no rest at the plan's end");
    }
    (total > 10.0).then_some("endless plan")
}
