//! The jerks that one joint may take for one tick. After each of them its stop still keeps every limit.
//!
//! With x' the state after a tick of jerk j, the upper conditions are
//!
//! ```text
//! a' <= A,   max(velocity in the tick, v' + a' |a'| / (2 J)) <= V,
//! max(position in the tick and along S(x')) <= q_max
//! ```
//!
//! The lower conditions are their mirror image. Position, velocity and acceleration at every instant grow
//! with j. So the upper conditions hold up to some j_hi, and the lower ones from some j_lo on. Bisection
//! finds the ends. The returned jerks have themselves been checked. So safety does not depend on that
//! monotonicity, and only tightness does.

use crate::plan::{JointState, JointStop, highest_of_phase, negated};
use messages::TICK_S;

/// Halvings of an interval of at most 2 J. They find its end to 2 J / 2^32, below 1e-9 of J.
const HALVINGS: u32 = 32;

/// The bounds within which one joint is planned. SI units, rad or m.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds {
    /// Lowest position.
    pub q_min: f64,
    /// Highest position.
    pub q_max: f64,
    /// Largest speed.
    pub v_max: f64,
    /// Largest magnitude of acceleration.
    pub a_max: f64,
    /// Largest magnitude of acceleration with which a stop brakes, at most `a_max`.
    pub brake: f64,
    /// Largest magnitude of jerk.
    pub j_max: f64,
}

impl Bounds {
    fn mirrored(&self) -> Self {
        Self { q_min: -self.q_max, q_max: -self.q_min, ..*self }
    }

    /// Returns true if a tick of jerk `j` from `x`, and the stop after it, keep every limit.
    pub fn admits(&self, x: JointState, j: f64) -> bool {
        j.abs() <= self.j_max && self.admits_above(x, j) && self.mirrored().admits_above(negated(x), -j)
    }

    /// Returns the admissible jerk nearest to `wanted`, or None if no jerk is admissible.
    pub fn nearest_admissible(&self, x: JointState, wanted: f64) -> Option<f64> {
        let wanted = wanted.clamp(-self.j_max, self.j_max);
        let mirrored = self.mirrored();
        let above = self.admits_above(x, wanted);
        let below = mirrored.admits_above(negated(x), -wanted);
        match (above, below) {
            (true, true) => Some(wanted),
            (false, false) => None,
            (false, true) => {
                let j = self.highest_jerk(x, wanted)?;
                mirrored.admits_above(negated(x), -j).then_some(j)
            }
            (true, false) => {
                let j = -mirrored.highest_jerk(negated(x), -wanted)?;
                self.admits_above(x, j).then_some(j)
            }
        }
    }

    /// Returns the interval [j_lo, j_hi] of admissible jerks, or None if it is empty.
    pub fn interval(&self, x: JointState) -> Option<[f64; 2]> {
        let high = self.highest_jerk(x, self.j_max)?;
        let low = -self.mirrored().highest_jerk(negated(x), self.j_max)?;
        (low <= high).then_some([low, high])
    }

    /// The largest jerk in [-J, `top`] that keeps the upper conditions.
    fn highest_jerk(&self, x: JointState, top: f64) -> Option<f64> {
        // The acceleration's own bound is exact. It saves halvings and never excludes an admissible jerk.
        let top = top.min((self.a_max - x.a) / TICK_S).max(-self.j_max);
        if self.admits_above(x, top) {
            return Some(top);
        }
        let (mut good, mut bad) = (-self.j_max, top);
        if !self.admits_above(x, good) {
            return None;
        }
        for _ in 0..HALVINGS {
            let middle = 0.5 * (good + bad);
            if self.admits_above(x, middle) {
                good = middle;
            } else {
                bad = middle;
            }
        }
        Some(good)
    }

    /// Returns true if the upper conditions hold.
    #[inline]
    fn admits_above(&self, x: JointState, j: f64) -> bool {
        let next = x.after(j, TICK_S);
        // At the acceleration limit (A - a) / h * h may round up by an ulp. The plan's margin of 0.5 % covers it.
        if next.a > self.a_max * (1.0 + 1e-12) || next.coasting_velocity(self.j_max) > self.v_max {
            return false;
        }
        if x.a > 0.0 && next.a < 0.0 && x.v - x.a * x.a / (2.0 * j) > self.v_max {
            return false;
        }
        // No speed on the way exceeds v_max, and no stop takes longer than V / brake + 3 A / J. So the stop
        // need not be computed far from the limit.
        let longest_s = TICK_S + self.v_max / self.brake + 3.0 * self.a_max / self.j_max;
        if x.q + self.v_max * longest_s < self.q_max {
            return true;
        }
        let (in_tick, _) = highest_of_phase(x, j, TICK_S);
        in_tick <= self.q_max && JointStop::new(next.v, next.a, self.brake, self.j_max).highest(next) <= self.q_max
    }
}
