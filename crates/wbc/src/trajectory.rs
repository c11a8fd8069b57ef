//! The motion that a candidate would start: a tick, then the stop. Each joint has a chain of constant-jerk pieces.

use crate::plan::{JointState, JointStop, PlannedMotion};
use messages::{JOINTS_MAX, JointMotion, TICK_S};

/// A tick, three phases, and the rest after them.
const KNOTS: usize = 5;

/// A state from which a constant jerk holds until the next knot.
#[derive(Clone, Copy, Debug, Default)]
struct Knot {
    t: f64,
    x: JointState,
    jerk: f64,
}

/// The motion of one joint from now to rest.
#[derive(Clone, Copy, Debug, Default)]
pub struct JointTrajectory {
    knots: [Knot; KNOTS],
    len: usize,
    /// Largest |jerk|.
    jerk_max: f64,
}

/// Bounds of one joint over a segment of time: rad or m, and seconds.
#[derive(Clone, Copy, Debug, Default)]
pub struct Swing {
    /// Largest speed.
    pub v: f64,
    /// Largest magnitude of acceleration.
    pub a: f64,
    /// Length of the path.
    pub path: f64,
}

/// Bounds of one joint over a segment of time, and the difference between its acceleration and the chord
/// there. Rad or m, and seconds.
#[derive(Clone, Copy, Debug, Default)]
pub struct Arc {
    /// Largest speed.
    pub v: f64,
    /// Largest magnitude of acceleration.
    pub a: f64,
    /// Largest magnitude of jerk.
    pub jerk: f64,
    /// Largest magnitude of the acceleration's chord.
    pub chord: f64,
    /// Magnitude of the chord's slope.
    pub slope: f64,
    /// Largest difference between the acceleration and its chord.
    pub kink: f64,
    /// Time of this largest difference, s.
    pub kink_t: f64,
}

impl JointTrajectory {
    /// Creates the motion of a tick of jerk `j` from `x`, then `stop`.
    pub fn tick_then_stop(x: JointState, j: f64, stop: &JointStop) -> Self {
        let mut motion = Self::default();
        let next = motion.push(x, j, TICK_S);
        motion.finish(next, stop);
        motion
    }

    fn push(&mut self, x: JointState, jerk: f64, duration: f64) -> JointState {
        let t = if self.len == 0 { 0.0 } else { self.knots[self.len].t };
        self.knots[self.len] = Knot { t, x, jerk };
        self.len += 1;
        self.jerk_max = self.jerk_max.max(jerk.abs());
        let next = x.after(jerk, duration);
        self.knots[self.len] = Knot { t: t + duration, x: next, jerk: 0.0 };
        next
    }

    fn finish(&mut self, x: JointState, stop: &JointStop) {
        let mut x = x;
        if self.len == 0 {
            self.knots[0].x = x;
        }
        for phase in 0..3 {
            if stop.duration_s[phase] > 0.0 {
                x = self.push(x, stop.jerk[phase], stop.duration_s[phase]);
            }
        }
        let end = &mut self.knots[self.len];
        (end.x.v, end.x.a) = (0.0, 0.0);
        self.len += 1;
    }

    /// Time at which the joint comes to rest, s from now.
    #[inline]
    pub fn end_s(&self) -> f64 {
        self.knots[self.len - 1].t
    }

    /// The state at `t` s from now.
    #[inline]
    pub fn at(&self, t: f64) -> JointState {
        let mut i = self.len - 1;
        while i > 0 && self.knots[i].t > t {
            i -= 1;
        }
        let knot = &self.knots[i];
        if i + 1 == self.len { knot.x } else { knot.x.after(knot.jerk, t - knot.t) }
    }

    /// Bounds over [t0, t1], with `x0` and `x1` the states at its ends.
    ///
    /// Acceleration is linear between knots, so its largest value is at an end or a knot. A velocity differs
    /// from the nearer end's by at most a dt / 2, and from its chord by at most max|jerk| dt^2 / 8.
    #[inline]
    pub fn swing(&self, t0: f64, t1: f64, x0: JointState, x1: JointState) -> Swing {
        let mut a = x0.a.abs().max(x1.a.abs());
        for knot in &self.knots[..self.len] {
            if knot.t > t0 && knot.t < t1 {
                a = a.max(knot.x.a.abs());
            }
        }
        let dt = t1 - t0;
        let v = x0.v.abs().max(x1.v.abs()) + (a * dt / 2.0).min(self.jerk_max * dt * dt / 8.0);
        Swing { v, a, path: v * dt }
    }

    /// Bounds over [t0, t1], with `x0` and `x1` the states at its ends. See [`swing`](Self::swing). The
    /// acceleration leaves its chord most at a knot.
    #[inline]
    pub fn arc(&self, t0: f64, t1: f64, x0: JointState, x1: JointState) -> Arc {
        let dt = t1 - t0;
        let slope = (x1.a - x0.a) / dt;
        let (mut a, mut jerk) = (x0.a.abs().max(x1.a.abs()), 0.0_f64);
        let (mut kink, mut kink_t) = (0.0, t0);
        for (i, knot) in self.knots[..self.len].iter().enumerate() {
            if knot.t > t0 && knot.t < t1 {
                a = a.max(knot.x.a.abs());
                let off = (knot.x.a - x0.a - slope * (knot.t - t0)).abs();
                if off > kink {
                    (kink, kink_t) = (off, knot.t);
                }
            }
            let until = if i + 1 < self.len { self.knots[i + 1].t } else { f64::INFINITY };
            if knot.t < t1 && until > t0 {
                jerk = jerk.max(knot.jerk.abs());
            }
        }
        let v = x0.v.abs().max(x1.v.abs()) + (a * dt / 2.0).min(jerk * dt * dt / 8.0);
        Arc { v, a, jerk, chord: x0.a.abs().max(x1.a.abs()), slope: slope.abs(), kink, kink_t }
    }

    /// Largest speed on the way. It is at an end of a piece, or inside one where its acceleration vanishes.
    pub fn fastest(&self) -> f64 {
        let mut fastest = 0.0_f64;
        for (i, knot) in self.knots[..self.len].iter().enumerate() {
            fastest = fastest.max(knot.x.v.abs());
            let turn = -knot.x.a / knot.jerk;
            if i + 1 < self.len && turn > 0.0 && turn < self.knots[i + 1].t - knot.t {
                fastest = fastest.max(knot.x.after(knot.jerk, turn).v.abs());
            }
        }
        fastest
    }

    /// Length of the whole path to rest. In a piece whose velocity keeps its sign it is |q1 - q0|. A piece is
    /// split where its acceleration vanishes, so that the velocity is monotone. A half whose velocity changes
    /// sign counts as max|v| dt.
    pub fn path(&self) -> f64 {
        let mut path = 0.0;
        for pair in self.knots[..self.len].windows(2) {
            let [from, to] = [pair[0], pair[1]];
            let dt = to.t - from.t;
            let turn = -from.x.a / from.jerk;
            if turn > 0.0 && turn < dt {
                let middle = from.x.after(from.jerk, turn);
                path += monotone_path(from.x, middle, turn) + monotone_path(middle, to.x, dt - turn);
            } else {
                path += monotone_path(from.x, to.x, dt);
            }
        }
        path
    }
}

#[inline]
fn monotone_path(from: JointState, to: JointState, dt: f64) -> f64 {
    if from.v * to.v >= 0.0 { (to.q - from.q).abs() } else { from.v.abs().max(to.v.abs()) * dt }
}

/// The motion of all joints, played together.
#[derive(Clone, Debug)]
pub struct Trajectory {
    /// One per joint.
    pub joints: [JointTrajectory; JOINTS_MAX],
}

impl Trajectory {
    /// Creates the motion of all joints on their stops.
    pub fn stops(planned: &JointMotion) -> Self {
        let mut motion = Self { joints: [JointTrajectory::default(); JOINTS_MAX] };
        for (j, joint) in motion.joints.iter_mut().enumerate() {
            joint.finish(planned.joint(j), &JointStop::from_plan(&planned.plan, j));
        }
        motion
    }

    /// Time at which the last joint comes to rest, s from now.
    pub fn end_s(&self) -> f64 {
        self.joints.iter().fold(0.0, |end, joint| f64::max(end, joint.end_s()))
    }

    /// The posture at `t` s from now.
    pub fn posture(&self, t: f64) -> [f64; JOINTS_MAX] {
        std::array::from_fn(|j| self.joints[j].at(t).q)
    }
}
