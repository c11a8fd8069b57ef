//! Compares the longest stop of any state that a certified plan may have with a closed-form bound.
//!
//! A joint at velocity v and acceleration a, with limits A and J, stops in three phases (`wbc::plan`). Bringing
//! the acceleration to zero leaves the velocity c = v + a |a| / 2J. In the direction of its sign s, with v and
//! a measured in that direction:
//!
//! ```text
//! A is reached:   T = (a + A) / J + (v / A + a^2 / 2JA - A / J) + A / J = v / A + a^2 / 2JA + (a + A) / J
//! A is not:       T = (a + 2 p) / J, p = sqrt(J v + a^2 / 2) <= A, which is no more: 2 p <= p^2 / A + A
//! ```
//!
//! For a >= 0 the time is c / A + (a + A) / J. For a < 0 it is convex in a, so it is at most the value at the
//! ends, c / A + A / J. Planning admits |c| <= V and |a| <= A, so no stop of a joint takes longer than
//!
//! ```text
//! D = V / A + 2 A / J                        reached at c = V, a = A (where V >= A^2 / J)
//! D(v) = |v| / A + 5 A / 2J                  of a joint whose speed is |v|, whatever its acceleration
//! ```
//!
//! From the end of a permit to exact rest, three times add up. Control sees the end at the next tick, and its
//! command is executed a tick later. The stop plays. Its last part of a tick counts as a whole tick:
//!
//! ```text
//! B(v) = 2 h + max_j D_j(v_j) + h
//! ```

use messages::{JOINTS_MAX, TICK_S};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use report::{derived_seed, in_parallel};
use wbc::interval::Bounds;
use wbc::{JointState, JointStop};

/// Ticks from the end of a permit to the first executed point of the stop.
const REACTION_TICKS: f64 = 2.0;
/// Ticks for the last part of a tick.
const ENDING_TICKS: f64 = 1.0;
/// Rounding of sums of durations below a second, s.
pub const TOLERANCE_S: f64 = 1e-9;
const PART_STATES: u64 = 20_000;
/// Largest number of draws of a joint's state until one is admissible. A joint near its limit has few
/// admissible states.
const DRAWS_MAX: u32 = 10_000;

/// Longest stop of any admitted state of a joint, s: V / A + 2 A / J.
pub fn joint_bound_s(bounds: &Bounds) -> f64 {
    bounds.v_max / bounds.a_max + 2.0 * bounds.a_max / bounds.j_max
}

/// Longest stop of a joint whose speed is |v|, s: |v| / A + 5 A / 2J.
pub fn joint_bound_at_s(bounds: &Bounds, v: f64) -> f64 {
    v.abs() / bounds.a_max + 2.5 * bounds.a_max / bounds.j_max
}

/// B(v): longest time from the end of a permit to exact rest, s, for joint velocities `v` (rad/s or m/s).
pub fn stop_bound_s(bounds: &[Bounds], v: &[f64; JOINTS_MAX]) -> f64 {
    let longest = (0..bounds.len()).map(|j| joint_bound_at_s(&bounds[j], v[j])).fold(0.0, f64::max);
    longest + reaction_s()
}

/// Time that is added to the length of a stop until exact rest, s.
pub fn reaction_s() -> f64 {
    (REACTION_TICKS + ENDING_TICKS) * TICK_S
}

#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct JointWorst {
    /// Longest stop, s.
    pub stop_s: f64,
    /// Velocity at the beginning of the longest stop.
    pub v: f64,
    /// Acceleration at the beginning of the longest stop.
    pub a: f64,
    /// Number of states whose stop is longer than a bound.
    pub exceeded: u64,
}

#[derive(Clone, Debug, Default, PartialEq)]
pub struct StopTimes {
    /// Number of states of all joints, without the corners.
    pub states: u64,
    pub joints: [JointWorst; JOINTS_MAX],
    /// Largest ratio of the longest of a state's stops to max_j D_j(v_j).
    pub share_of_bound: f64,
}

impl StopTimes {
    pub fn exceeded(&self) -> u64 {
        self.joints.iter().map(|joint| joint.exceeded).sum()
    }

    fn record(&mut self, bounds: &[Bounds], j: usize, x: JointState) -> f64 {
        let stop_s = JointStop::new(x.v, x.a, bounds[j].a_max, bounds[j].j_max).total_s();
        let (bound, bound_at) = (joint_bound_s(&bounds[j]), joint_bound_at_s(&bounds[j], x.v));
        let worst = &mut self.joints[j];
        if stop_s > worst.stop_s {
            (worst.stop_s, worst.v, worst.a) = (stop_s, x.v, x.a);
        }
        let within = stop_s <= bound + TOLERANCE_S && stop_s <= bound_at + TOLERANCE_S;
        worst.exceeded += u64::from(!within);
        stop_s
    }

    fn merge(&mut self, other: &Self) {
        self.states += other.states;
        self.share_of_bound = self.share_of_bound.max(other.share_of_bound);
        for (mine, theirs) in self.joints.iter_mut().zip(&other.joints) {
            let exceeded = mine.exceeded + theirs.exceeded;
            if theirs.stop_s > mine.stop_s {
                *mine = *theirs;
            }
            mine.exceeded = exceeded;
        }
    }
}

/// Measures `states` random states and the corners of every joint. Gives `done` the number of states of each part.
pub fn run(bounds: &[Bounds], states: u64, seed: u64, threads: usize, done: impl Fn(u64) + Sync) -> StopTimes {
    let parts = states.div_ceil(PART_STATES) as usize;
    let measured = in_parallel(threads, parts, |part| {
        let count = PART_STATES.min(states - part as u64 * PART_STATES);
        let measured = random(bounds, count, derived_seed(seed, part as u64));
        done(count);
        measured
    });
    let mut all = corners(bounds);
    measured.iter().for_each(|part| all.merge(part));
    all
}

fn random(bounds: &[Bounds], states: u64, seed: u64) -> StopTimes {
    let mut rng = Pcg64::seed_from_u64(seed);
    let mut out = StopTimes { states, ..StopTimes::default() };
    for _ in 0..states {
        let (mut longest, mut bound) = (0.0_f64, 0.0_f64);
        for j in 0..bounds.len() {
            let Some(x) = admitted(&bounds[j], &mut rng) else { continue };
            longest = longest.max(out.record(bounds, j, x));
            bound = bound.max(joint_bound_at_s(&bounds[j], x.v));
        }
        out.share_of_bound = out.share_of_bound.max(longest / bound);
    }
    out
}

/// Draws a state that planning admits: a random one after one tick of an admissible jerk.
fn admitted(b: &Bounds, rng: &mut Pcg64) -> Option<JointState> {
    (0..DRAWS_MAX).find_map(|_| {
        // Every second state is near the limits of speed and acceleration, where stops are long.
        let near = if rng.random_bool(0.5) { 0.9 } else { -1.0 };
        let sign = if rng.random_bool(0.5) { 1.0 } else { -1.0 };
        let mut share = || sign * rng.random_range(near..=1.0);
        let (v, a) = (share() * b.v_max, share() * b.a_max);
        let x = JointState { q: rng.random_range(b.q_min..=b.q_max), v, a };
        let jerk = b.nearest_admissible(x, rng.random_range(-b.j_max..=b.j_max))?;
        b.admits(x, jerk).then(|| x.after(jerk, TICK_S))
    })
}

/// Measures the corners of velocity and acceleration that planning admits somewhere in the range. The longest
/// stop begins at full acceleration, just without exceeding the largest speed.
fn corners(bounds: &[Bounds]) -> StopTimes {
    // Slightly inside the bounds, because planning compares exactly.
    const INSIDE: f64 = 1.0 - 1e-12;
    let mut out = StopTimes::default();
    for (j, b) in bounds.iter().enumerate() {
        let rise = b.a_max * b.a_max / (2.0 * b.j_max);
        for (v, a) in [(b.v_max - rise, b.a_max), (b.v_max, 0.0), (b.v_max, -b.a_max), (0.0, b.a_max), (-rise, b.a_max)]
        {
            for sign in [1.0, -1.0] {
                let after = JointState { q: 0.5 * (b.q_min + b.q_max), v: sign * v * INSIDE, a: sign * a * INSIDE };
                let before = after.after(0.0, -TICK_S);
                if b.admits(before, 0.0) {
                    out.record(bounds, j, before.after(0.0, TICK_S));
                }
            }
        }
    }
    out
}
