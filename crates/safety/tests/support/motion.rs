//! Proposals for the gate in plain `f64`.

use judge::joint::{Joint, Stop};
use messages::{JOINTS_MAX, JointMotion, Layout, StopPlan, TICK_S};
use robot::JointLimits;
use safety::engage::Permit;
use safety::gate::Proposed;

pub const T: f64 = TICK_S;

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

pub const NO_PLAN: StopPlan = StopPlan::ZERO;

pub fn resting(k: u64, q: [f64; JOINTS_MAX]) -> Proposed {
    let permit = Permit::Follow { speed_scale: 1.0 };
    Proposed { k, permit, motion: JointMotion::rest(q) }
}

pub fn joint(motion: &JointMotion, j: usize) -> Joint {
    Joint { q: motion.q[j], v: motion.v[j], a: motion.a[j] }
}

pub fn set_joint(p: &mut Proposed, j: usize, x: Joint) {
    (p.motion.q[j], p.motion.v[j], p.motion.a[j]) = (x.q, x.v, x.a);
}

/// Sets a joint and its fastest stop from there. Returns the stop.
pub fn set_stopping(p: &mut Proposed, j: usize, x: Joint, limits: &JointLimits) -> Stop {
    let stop = stop_from(x, limits.a_max, limits.j_max);
    set_joint(p, j, x);
    store(&mut p.motion.plan, j, &stop);
    stop
}
