//! The stop of one joint: three phases of constant jerk, in closed form.
//!
//! The jerk bound is J and the acceleration cap A. A joint at (v, a) that only brings its acceleration to
//! zero ends at the velocity v_c = v + a |a| / (2 J). The time-optimal stop brakes against the sign s of v_c.
//! In coordinates where s = +1:
//!
//! ```text
//! phase 1: a -> -a_p     a_p = min(A, sqrt(J v + a^2 / 2)),   t1 = |a + a_p| / J
//! phase 2: a = -a_p      t2 = (v1 - a_p^2 / (2 J)) / a_p      (zero unless a_p = A), v1 = v + t1 (a - a_p) / 2
//! phase 3: -a_p -> 0     t3 = a_p / J
//! ```
//!
//! Without the cap, a_p follows from v + a^2 / (2 J) = a_p^2 / J. The stop is time-optimal. So the rest of it
//! after some time is the stop of the state at that time, and a tick along the plan never lengthens it.

use messages::{JOINTS_MAX, JointMotion, StopPlan};

/// Position, velocity and acceleration of one joint. Rad or m, and seconds.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct JointState {
    /// Position, rad or m.
    pub q: f64,
    /// Velocity, rad/s or m/s.
    pub v: f64,
    /// Acceleration, rad/s^2 or m/s^2.
    pub a: f64,
}

/// The stop of one joint: jerk and duration of its three phases.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct JointStop {
    /// Jerk of each phase, rad/s^3 or m/s^3.
    pub jerk: [f64; 3],
    /// Duration of each phase, s.
    pub duration_s: [f64; 3],
}

impl JointState {
    /// The state after `t` seconds of constant jerk `j`.
    #[inline]
    pub fn after(self, j: f64, t: f64) -> Self {
        Self {
            q: self.q + t * (self.v + t * (self.a / 2.0 + t * j / 6.0)),
            v: self.v + t * (self.a + t * j / 2.0),
            a: self.a + t * j,
        }
    }

    /// Velocity that is left after the acceleration has been brought to zero at jerk `j_max`.
    #[inline]
    pub fn coasting_velocity(self, j_max: f64) -> f64 {
        self.v + self.a * self.a.abs() / (2.0 * j_max)
    }

    /// Returns true if velocity and acceleration are exactly zero.
    pub fn is_at_rest(self) -> bool {
        self.v == 0.0 && self.a == 0.0
    }
}

impl JointStop {
    /// The time-optimal stop from velocity `v` and acceleration `a` with |jerk| <= `j_max` and |acceleration|
    /// <= `a_max`. An acceleration beyond `a_max` is first brought back to it.
    #[inline]
    pub fn new(v: f64, a: f64, a_max: f64, j_max: f64) -> Self {
        let coasting = v + a * a.abs() / (2.0 * j_max);
        let s = if coasting < 0.0 { -1.0 } else { 1.0 };
        let (v, a) = (s * v, s * a);
        let free = (j_max * v + a * a / 2.0).max(0.0).sqrt();
        let peak = free.min(a_max);
        let first = (a + peak).abs() / j_max;
        let cruise = if free > a_max {
            let v1 = v + first * (a - peak) / 2.0;
            ((v1 - peak * peak / (2.0 * j_max)) / peak).max(0.0)
        } else {
            0.0
        };
        let first_jerk = if a + peak < 0.0 { j_max } else { -j_max };
        Self { jerk: [s * first_jerk, 0.0, s * j_max], duration_s: [first, cruise, peak / j_max] }
    }

    /// Reads the stop of joint `j` from a plan.
    pub fn from_plan(plan: &StopPlan, j: usize) -> Self {
        Self { jerk: plan.jerk[j], duration_s: plan.duration_s[j] }
    }

    /// Writes this stop into joint `j` of a plan.
    pub fn store(self, plan: &mut StopPlan, j: usize) {
        plan.jerk[j] = self.jerk;
        plan.duration_s[j] = self.duration_s;
    }

    /// Time to rest, s.
    pub fn total_s(&self) -> f64 {
        self.duration_s[0] + self.duration_s[1] + self.duration_s[2]
    }

    /// Returns true if nothing is left to play.
    pub fn is_done(&self) -> bool {
        self.duration_s == [0.0; 3]
    }

    /// Plays `dt` seconds of the stop. Returns the state then, and the rest of the stop. At the end, velocity
    /// and acceleration are set to zero, because only rounding remains there and would drift.
    pub fn advance(mut self, mut x: JointState, dt: f64) -> (JointState, Self) {
        let mut left = dt;
        for phase in 0..3 {
            let t = left.min(self.duration_s[phase]);
            if t > 0.0 {
                x = x.after(self.jerk[phase], t);
                self.duration_s[phase] -= t;
                left -= t;
            }
        }
        if self.is_done() {
            (x.v, x.a) = (0.0, 0.0);
            self.jerk = [0.0; 3];
        }
        (x, self)
    }

    /// Position at which the stop from `x` ends.
    #[inline]
    pub fn stop_position(&self, x: JointState) -> f64 {
        let mut x = x;
        for phase in 0..3 {
            x = x.after(self.jerk[phase], self.duration_s[phase]);
        }
        x.q
    }

    /// The largest position along the stop from `x`.
    #[inline]
    pub fn highest(&self, x: JointState) -> f64 {
        let mut x = x;
        let mut highest = x.q;
        for phase in 0..3 {
            let (top, end) = highest_of_phase(x, self.jerk[phase], self.duration_s[phase]);
            highest = highest.max(top);
            x = end;
        }
        highest
    }

    /// The smallest and the largest position along the stop from `x`.
    pub fn extremes(&self, x: JointState) -> (f64, f64) {
        let mirrored = Self { jerk: self.jerk.map(|j| -j), ..*self };
        (-mirrored.highest(negated(x)), self.highest(x))
    }
}

/// Returns the state seen from the other direction.
#[inline]
pub(crate) fn negated(x: JointState) -> JointState {
    JointState { q: -x.q, v: -x.v, a: -x.a }
}

/// Largest position within `t` seconds of constant jerk `j` from `x`, and the state at the end. The
/// candidates are the ends, and the points of zero velocity between them.
#[inline]
pub(crate) fn highest_of_phase(x: JointState, j: f64, t: f64) -> (f64, JointState) {
    let end = x.after(j, t);
    let mut highest = x.q.max(end.q);
    let monotone = x.v * end.v > 0.0 && x.a * end.a >= 0.0;
    if !monotone {
        for root in zero_velocity(x.v, x.a, j) {
            if root > 0.0 && root < t {
                highest = highest.max(x.after(j, root).q);
            }
        }
    }
    (highest, end)
}

/// Both times at which v + a t + j t^2 / 2 = 0. NaN or infinite if there is no such time.
#[inline]
fn zero_velocity(v: f64, a: f64, j: f64) -> [f64; 2] {
    let discriminant = a * a - 2.0 * j * v;
    // Citardauq form: no cancellation, and it holds for j = 0.
    let shifted = -(a + discriminant.sqrt().copysign(a));
    [shifted / j, 2.0 * v / shifted]
}

/// Functions of whole-body control on a motion and its stop.
pub trait PlannedMotion {
    /// State of joint `j`.
    fn joint(&self, j: usize) -> JointState;

    /// Sets state and stop of joint `j`.
    fn set_joint(&mut self, j: usize, x: JointState, stop: JointStop);

    /// The motion after `dt` seconds of the plan, all joints together.
    #[must_use]
    fn advanced(&self, dt: f64) -> Self;

    /// Posture at which the plan comes to rest.
    fn rest_posture(&self) -> [f64; JOINTS_MAX];
}

impl PlannedMotion for JointMotion {
    #[inline]
    fn joint(&self, j: usize) -> JointState {
        JointState { q: self.q[j], v: self.v[j], a: self.a[j] }
    }

    #[inline]
    fn set_joint(&mut self, j: usize, x: JointState, stop: JointStop) {
        (self.q[j], self.v[j], self.a[j]) = (x.q, x.v, x.a);
        stop.store(&mut self.plan, j);
    }

    fn advanced(&self, dt: f64) -> Self {
        let mut next = *self;
        for j in 0..JOINTS_MAX {
            let (x, stop) = JointStop::from_plan(&self.plan, j).advance(self.joint(j), dt);
            next.set_joint(j, x, stop);
        }
        next
    }

    fn rest_posture(&self) -> [f64; JOINTS_MAX] {
        std::array::from_fn(|j| JointStop::from_plan(&self.plan, j).stop_position(self.joint(j)))
    }
}
