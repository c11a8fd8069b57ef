//! Judges every command with its own arithmetic: limits, continuity, the plan, and plain distances.

use super::Subject;
use messages::{JOINTS, StopPlan, TICK_S};
use nalgebra::{Point3, Vector3};
use wbc::geometry::BodyCapsule;
use wbc::{Output, Planned};

/// Rounding of positions, velocities and accelerations that another formula recomputes.
const ROUNDING: f64 = 1e-11;

/// Judges postures and commands.
pub struct Checker {
    subject: Subject,
    before: Planned,
    /// Smallest clearance seen, m.
    pub clearance_m: f64,
    /// Number of violations. The first few are described in words.
    pub violations: u64,
    pub first: Vec<String>,
}

impl Checker {
    pub fn new(subject: &Subject, start: &Planned) -> Self {
        Self { subject: subject.clone(), before: *start, clearance_m: f64::INFINITY, violations: 0, first: Vec::new() }
    }

    fn violated(&mut self, what: impl FnOnce() -> String) {
        self.violations += 1;
        if self.first.len() < 8 {
            self.first.push(what());
        }
    }

    /// Judges the command of one tick. `dense` also samples its plan every millisecond.
    pub fn command(&mut self, k: u64, out: &Output, dense: bool) {
        let now = Planned { q: out.q, v: out.v, a: out.a, plan: out.plan };
        for j in 0..JOINTS {
            self.joint_state(k, j, &now);
            if out.on_plan & 1 << j == 0 {
                self.new_decision(k, j, &now);
            } else {
                self.next_of_plan(k, j, &now);
            }
            self.joint_plan(k, j, &now);
        }
        self.posture(k, &now.q, "command");
        if dense {
            let mut t = 0.0;
            while t < 1.5 {
                let q = std::array::from_fn(|j| play(&now, j, t).0);
                self.posture(k, &q, "plan");
                t += 1e-3;
            }
        }
        self.before = now;
    }

    fn joint_state(&mut self, k: u64, j: usize, now: &Planned) {
        let l = self.subject.limits[j];
        let inside = now.q[j] >= l.q_min && now.q[j] <= l.q_max;
        if !(inside && now.v[j].abs() <= l.v_max && now.a[j].abs() <= l.a_max) {
            self.violated(|| format!("k {k} joint {j}: q {} v {} a {} outside limits", now.q[j], now.v[j], now.a[j]));
        }
    }

    fn new_decision(&mut self, k: u64, j: usize, now: &Planned) {
        let (q0, v0, a0) = (self.before.q[j], self.before.v[j], self.before.a[j]);
        let jerk = (now.a[j] - a0) / TICK_S;
        let v = v0 + a0 * TICK_S + jerk * TICK_S.powi(2) / 2.0;
        let q = q0 + v0 * TICK_S + a0 * TICK_S.powi(2) / 2.0 + jerk * TICK_S.powi(3) / 6.0;
        let l = self.subject.limits[j];
        if jerk.abs() > l.j_max || (v - now.v[j]).abs() > ROUNDING || (q - now.q[j]).abs() > ROUNDING {
            self.violated(|| format!("k {k} joint {j}: jerk {jerk}, v {v} != {}, q {q} != {}", now.v[j], now.q[j]));
        }
        let turn = -a0 / jerk;
        if turn > 0.0 && turn < TICK_S && (v0 + a0 * turn / 2.0).abs() > l.v_max {
            self.violated(|| format!("k {k} joint {j}: speed in the tick"));
        }
    }

    fn next_of_plan(&mut self, k: u64, j: usize, now: &Planned) {
        let (q, v, a) = play(&self.before, j, TICK_S);
        let off = (q - now.q[j]).abs().max((v - now.v[j]).abs()).max((a - now.a[j]).abs());
        if off > ROUNDING {
            self.violated(|| format!("k {k} joint {j}: {off} off the plan"));
        }
    }

    fn joint_plan(&mut self, k: u64, j: usize, now: &Planned) {
        let l = self.subject.limits[j];
        let (mut worst_q, mut worst_a, mut fastest, mut t) = (0.0_f64, 0.0_f64, 0.0_f64, 0.0);
        let total: f64 = now.plan.duration_s[j].iter().sum();
        for i in 0..=24 {
            t = total * f64::from(i) / 24.0;
            let (q, v, a) = play(now, j, t);
            worst_q = worst_q.max(l.q_min - q).max(q - l.q_max);
            worst_a = worst_a.max(a.abs());
            fastest = fastest.max(v.abs());
        }
        let (_, v, a) = play(now, j, t);
        let jerk = now.plan.jerk[j].iter().fold(0.0_f64, |m, j| m.max(j.abs()));
        let bad = worst_q > 0.0 || worst_a > l.a_max || fastest > l.v_max || jerk > l.j_max;
        if bad || v.abs() > 1e-9 || a.abs() > 1e-9 {
            self.violated(|| {
                format!("k {k} joint {j}: plan exceeds by {worst_q}, a {worst_a}, v {fastest}, j {jerk}, end {v} {a}")
            });
        }
    }

    fn posture(&mut self, k: u64, q: &[f64; JOINTS], what: &str) {
        let d = self.clearance(q);
        self.clearance_m = self.clearance_m.min(d);
        if d < self.subject.d_min_m {
            self.violated(|| format!("k {k}: clearance of the {what} {d}"));
        }
    }

    /// Smallest distance of all pairs at a posture.
    pub fn clearance(&self, q: &[f64; JOINTS]) -> f64 {
        let bodies = self.subject.bodies(q);
        let axis = |c: &BodyCapsule| [c.a, c.b].map(|p| (bodies[c.body] * Point3::from(p)).coords);
        let axes: Vec<_> = self.subject.capsules.iter().map(axis).collect();
        let mut smallest = f64::INFINITY;
        for &[a, b] in &self.subject.pairs {
            let radii = self.subject.capsules[a].radius_m + self.subject.capsules[b].radius_m;
            smallest = smallest.min(axis_distance(axes[a], axes[b]) - radii);
        }
        smallest
    }
}

/// Joint `j` of a plan after `t` seconds.
pub fn play(p: &Planned, j: usize, t: f64) -> (f64, f64, f64) {
    let StopPlan { jerk, duration_s } = &p.plan;
    let (mut q, mut v, mut a, mut left) = (p.q[j], p.v[j], p.a[j], t);
    for i in 0..3 {
        let dt = left.clamp(0.0, duration_s[j][i]);
        q += v * dt + a * dt * dt / 2.0 + jerk[j][i] * dt * dt * dt / 6.0;
        v += a * dt + jerk[j][i] * dt * dt / 2.0;
        a += jerk[j][i] * dt;
        left -= dt;
    }
    (q, v, a)
}

/// Distance of two segments. It is the distance of an end from a segment, or of both lines if the feet of
/// their common normal lie inside.
pub fn axis_distance(p: [Vector3<f64>; 2], q: [Vector3<f64>; 2]) -> f64 {
    let to_segment = |x: Vector3<f64>, s: [Vector3<f64>; 2]| {
        let d = s[1] - s[0];
        let along = if d.norm() < 1e-9 { 0.0 } else { ((x - s[0]).dot(&d) / d.dot(&d)).clamp(0.0, 1.0) };
        (s[0] + d * along - x).norm()
    };
    let ends = to_segment(p[0], q).min(to_segment(p[1], q)).min(to_segment(q[0], p)).min(to_segment(q[1], p));
    let (u, v) = (p[1] - p[0], q[1] - q[0]);
    let normal = u.cross(&v);
    if normal.norm() < 1e-9 {
        return ends;
    }
    let between = q[0] - p[0];
    let s = between.cross(&v).dot(&normal) / normal.norm_squared();
    let t = between.cross(&u).dot(&normal) / normal.norm_squared();
    let inside = (0.0..=1.0).contains(&s) && (0.0..=1.0).contains(&t);
    if inside { ends.min(between.dot(&normal).abs() / normal.norm()) } else { ends }
}
