//! Kinematics in integers. The result is the same on every machine.
//!
//! Positions, velocities, accelerations and jerks are counted in 2^-40 of their SI unit (0.91 picorad and the like).
//! Times are counted in 2^-48 s. A tick of 1/1500 s is not a whole number of these units. So ticks are counted and then
//! converted, and the error of one tick (0.8e-15 s) does not add up. Scaling an `f64` by a power of two is exact, so
//! the only rounding is to the nearest unit. Ceilings keep every intermediate value inside its type:
//!
//! | quantity | ceiling, SI | units |
//! |---|---|---|
//! | position, velocity | 2^6 | 2^46 |
//! | acceleration | 2^12 | 2^52 |
//! | jerk | 2^20 | 2^60 |
//! | time | 2^4 s | 2^52 |
//!
//! Products are computed in `i128`. Results beyond a ceiling are clamped to just above it, and no limit
//! admits that value.
//!
//! Nothing can overflow, and no conversion to `i64` can cut anything off. The bounds are Q, V <= 2^46 + 1, A
//! <= 2^52 + 1, J <= 2^60 and T <= 2^52. `quantise` ensures them for inputs, `clamped` for results. Limits
//! are within the same ceilings. Then:
//!
//! | operation | where | at most | type |
//! |---|---|---|---|
//! | ticks 2^48 + 750, ticks <= 2^20 | `ticks_long` | 2^68 + 750, as `i64` after the division 2^58 | `i128` |
//! | j t + 2^47 | `after` | 2^112 + 2^47 | `i128` |
//! | j t / 2^48 + a | `after` | 2^64 + 2^53, clamped to A | `i128` |
//! | a + a' | `reaching` | 2^53 + 2 | `i64` |
//! | (a + a') t | `reaching` | 2^105 + 2^53 | `i128` |
//! | 6 v | `reaching` | 2^49 | `i64` |
//! | 2 a + a' | `reaching` | 3 * 2^52 + 3 < 2^54 | `i64` |
//! | (2 a + a') t / 2^48, as `i64` | `reaching` | 3 * 2^56 + 13 < 2^58 | `i128` |
//! | slope = 6 v + (2 a + a') t / 2^48 | `reaching` | 2^58 | `i64` |
//! | slope t | `reaching` | 2^110 | `i128` |
//! | slope t / 2^48 + 3, as `i64` (which divides faster) | `reaching` | 2^62 + 4 | `i128` |
//! | x - y of two points | `is_near` | 2^53 + 2 | `i64` |
//! | a 2^48 | `turn` | 2^100 + 2^48; the quotient is clamped to the duration | `i128` |
//! | low + (high - low) / 2 | `note_turn` | T | `i64` |
//! | limit + slack | `check` | 2^60 + 96,000 | `i64` |
//! | (a' - a) 1500 | `Limits::step` | (2^53 + 2) 1500 < 2^64, as `i64` once within the jerk limit | `i128` |
//! | sum of three durations | `Limits::stop` | 3 * 2^52 | `i64` |
//! | difference of durations, jerks | `same_stop` | 2^52, 2^61 | `i64` |
//! | a duration less what is played of it | `stored` | T | `i64` |
//! | ticks played, indices, counts | `stored`, `tick` | saturating | `u64` |
//!
//! The tests of `ceilings` run all of them at both ends of their ranges, in builds that check for overflow.

use messages::TICK_HZ;

/// Units per SI unit of position, velocity, acceleration and jerk.
pub(super) const UNITS: f64 = (1_u64 << 40) as f64;
/// Units of time per second, as a power of two.
const TIME_BITS: u32 = 48;
/// Units of time per second.
pub(super) const TIME_UNITS: f64 = (1_u64 << TIME_BITS) as f64;
/// A tick, in units of time, rounded to the nearest.
pub(super) const TICK: i64 = ((1_i64 << TIME_BITS) + TICK_HZ as i64 / 2) / TICK_HZ as i64;

/// Highest position and velocity, SI.
pub(super) const MOTION_CEILING: f64 = 64.0;
/// Highest acceleration, SI.
pub(super) const ACCELERATION_CEILING: f64 = 4096.0;
/// Highest jerk, SI.
pub(super) const JERK_CEILING: f64 = 1_048_576.0;
/// Longest phase, s.
pub(super) const TIME_CEILING_S: f64 = 16.0;

const MOTION_CLAMP: i64 = (1 << 46) + 1;
const ACCELERATION_CLAMP: i64 = (1 << 52) + 1;

/// Returns the length of `ticks` (at most 2^20) in units of time, to the nearest. A tick is not a whole
/// number of units. The result errs by at most one unit, however many ticks there are.
pub(super) fn ticks_long(ticks: u64) -> i64 {
    let ticks = i128::from(ticks.min(1 << 20));
    (((ticks << TIME_BITS) + i128::from(TICK_HZ) / 2) / i128::from(TICK_HZ)) as i64
}

/// Returns the least number of ticks that are as long as `duration`. It must not be negative, and at most
/// three times the longest phase.
pub(super) fn ticks_of(duration: i64) -> u64 {
    // The length of n ticks is 2^48 n / 1500, rounded to the nearest. So it is at least `duration` from 2^48
    // n / 1500 >= duration - 1/2 on.
    let ticks = (2 * i128::from(duration) - 1) * i128::from(TICK_HZ) + ((1 << (TIME_BITS + 1)) - 1);
    (ticks >> (TIME_BITS + 1)) as u64
}

/// Returns `value` in units, or None if it is not finite or beyond the ceiling.
pub(super) fn quantise(value: f64, ceiling: f64, units: f64) -> Option<i64> {
    (value.abs() <= ceiling).then(|| (value * units).round_ties_even() as i64)
}

/// Returns x t / 2^bits, rounded to the nearest.
fn scaled(x: i64, t: i64, bits: u32) -> i128 {
    (i128::from(x) * i128::from(t) + (1 << (bits - 1))) >> bits
}

fn clamped(value: i128, clamp: i64) -> i64 {
    value.clamp(-i128::from(clamp), i128::from(clamp)) as i64
}

/// Position, velocity and acceleration of a joint, in units.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Point {
    pub(super) q: i64,
    pub(super) v: i64,
    pub(super) a: i64,
}

/// A phase of constant jerk, in units.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Phase {
    pub(super) jerk: i64,
    pub(super) duration: i64,
}

/// Least and greatest position and velocity of a phase, in units.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Extremes {
    pub(super) q: [i64; 2],
    pub(super) v: [i64; 2],
}

impl Point {
    /// Returns None if a value is not finite or beyond its ceiling.
    pub(super) fn quantised(q: f64, v: f64, a: f64) -> Option<Self> {
        Some(Self {
            q: quantise(q, MOTION_CEILING, UNITS)?,
            v: quantise(v, MOTION_CEILING, UNITS)?,
            a: quantise(a, ACCELERATION_CEILING, UNITS)?,
        })
    }

    /// State after `t` of constant jerk: a' = a + j t, v' = v + (a + a') t / 2, q' = q + (6 v + (2 a + a') t) t / 6.
    pub(super) fn after(self, jerk: i64, t: i64) -> Self {
        if t == 0 {
            // The sums below would add nothing.
            return self;
        }
        let a = clamped(i128::from(self.a) + scaled(jerk, t, TIME_BITS), ACCELERATION_CLAMP);
        self.reaching(a, t)
    }

    /// State after `t` in which the acceleration changes linearly to `a`.
    pub(super) fn reaching(self, a: i64, t: i64) -> Self {
        let v = i128::from(self.v) + scaled(self.a + a, t, TIME_BITS + 1);
        let slope = 6 * self.v + scaled(2 * self.a + a, t, TIME_BITS) as i64;
        let six = scaled(slope, t, TIME_BITS) as i64;
        let q = i128::from(self.q) + i128::from((six + 3).div_euclid(6));
        Self { q: clamped(q, MOTION_CLAMP), v: clamped(v, MOTION_CLAMP), a }
    }

    /// Returns true if the two differ by at most `slack` units in each value.
    pub(super) fn is_near(self, other: Self, slack: i64) -> bool {
        let near = |x: i64, y: i64| (x - y).abs() <= slack;
        near(self.q, other.q) && near(self.v, other.v) && near(self.a, other.a)
    }
}

impl Phase {
    /// Time within the phase at which the acceleration, which begins at `a`, is zero or nearest to zero.
    fn turn(self, a: i64) -> i64 {
        let (against, jerk) = (-i128::from(a) << TIME_BITS, i128::from(self.jerk));
        // A quotient is slow. It would be clamped to one of the ends in most phases, as a product tells.
        if jerk == 0 || against.signum() != jerk.signum() {
            return 0;
        }
        if against.abs() >= jerk.abs() * i128::from(self.duration) {
            return self.duration;
        }
        (against / jerk) as i64
    }

    /// Returns the end of the phase that begins at `start`, and its extremes. The velocity is extreme at the ends and
    /// where the acceleration is zero. The position is extreme at the ends and where the velocity is zero.
    pub(super) fn play(self, start: Point) -> (Point, Extremes) {
        let end = start.after(self.jerk, self.duration);
        let turn = self.turn(start.a);
        let v = if turn == self.duration { end.v } else { start.after(self.jerk, turn).v };
        let [least, most] = sorted(start.v, end.v);
        let mut extremes = Extremes { q: sorted(start.q, end.q), v: [least.min(v), most.max(v)] };
        extremes.note_turn(start, self.jerk, [0, turn], [start.v, v]);
        extremes.note_turn(start, self.jerk, [turn, self.duration], [v, end.v]);
        (end, extremes)
    }
}

fn sorted(x: i64, y: i64) -> [i64; 2] {
    [x.min(y), x.max(y)]
}

/// The bisection below stops at 2^20 units of time, 3.7 ns. From there to the turning point the position
/// changes by at most a t^2 / 2, which is 7e-15 rad at 1000 rad/s^2.
const BISECTION_END: i64 = 1 << 20;

impl Extremes {
    /// Notes the position at which the velocity passes zero. The velocity is monotone over `span` of time,
    /// and is `v` at its ends.
    fn note_turn(&mut self, start: Point, jerk: i64, span: [i64; 2], v: [i64; 2]) {
        if v[0].signum() * v[1].signum() >= 0 {
            return;
        }
        let [mut low, mut high] = span;
        while high - low > BISECTION_END {
            let middle = low + (high - low) / 2;
            if start.after(jerk, middle).v.signum() == v[0].signum() {
                low = middle;
            } else {
                high = middle;
            }
        }
        let q = start.after(jerk, high).q;
        self.q = [self.q[0].min(q), self.q[1].max(q)];
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};

    fn random(rng: &mut rand_pcg::Pcg64, ceiling: f64) -> f64 {
        rng.random_range(-ceiling..=ceiling)
    }

    #[test]
    fn integration_matches_polynomial() {
        let mut rng = rand_pcg::Pcg64::seed_from_u64(1);
        for _ in 0..100_000 {
            let (q, v, a, j) =
                (random(&mut rng, 3.0), random(&mut rng, 3.0), random(&mut rng, 10.0), random(&mut rng, 400.0));
            let t: f64 = rng.random_range(0.0..0.5);
            let end = Point::quantised(q, v, a).unwrap().after((j * UNITS) as i64, (t * TIME_UNITS) as i64);
            let expected = [q + t * (v + t * (a / 2.0 + t * j / 6.0)), v + t * (a + t * j / 2.0), a + t * j];
            for (got, expected) in [end.q, end.v, end.a].into_iter().zip(expected) {
                assert!((got as f64 / UNITS - expected).abs() < 8.0 / UNITS, "{got} {expected}");
            }
        }
    }

    #[test]
    fn duration_of_many_ticks_is_exact_and_saturates() {
        assert_eq!(ticks_long(1), TICK);
        assert_eq!(ticks_long(1500), 1 << TIME_BITS);
        assert_eq!(ticks_long(u64::MAX), ticks_long(1 << 20));
    }

    #[test]
    fn ticks_of_duration_are_fewest_that_are_long_enough() {
        for ticks in (1..3000).chain([73_499, 73_500]) {
            let long = ticks_long(ticks);
            assert_eq!((ticks_of(long), ticks_of(long + 1)), (ticks, ticks + 1));
            assert!(ticks_long(ticks_of(long - 1)) >= long - 1 && ticks_of(long - 1) == ticks, "{ticks}");
        }
        assert_eq!((ticks_of(0), ticks_of(1)), (0, 1));
    }

    #[test]
    fn motion_at_ceilings_saturates_without_overflow() {
        // Builds with overflow checks panic. Other builds would end with the wrong sign.
        for signs in 0..16_u32 {
            let [sq, sv, sa, sj] = [1, 2, 4, 8].map(|bit| if signs & bit == 0 { 1.0 } else { -1.0 });
            let start = Point::quantised(sq * MOTION_CEILING, sv * MOTION_CEILING, sa * ACCELERATION_CEILING).unwrap();
            let jerk = quantise(sj * JERK_CEILING, JERK_CEILING, UNITS).unwrap();
            let phase = Phase { jerk, duration: quantise(TIME_CEILING_S, TIME_CEILING_S, TIME_UNITS).unwrap() };
            let mut point = start;
            for _ in 0..4 {
                (point, _) = phase.play(point);
            }
            let sign = sj as i64;
            assert_eq!(
                (point.a, point.v, point.q),
                (sign * ACCELERATION_CLAMP, sign * MOTION_CLAMP, sign * MOTION_CLAMP)
            );
        }
    }

    #[test]
    fn extremes_match_dense_samples() {
        let mut rng = rand_pcg::Pcg64::seed_from_u64(2);
        for _ in 0..5_000 {
            let start = Point::quantised(0.0, random(&mut rng, 1.0), random(&mut rng, 8.0)).unwrap();
            let phase = Phase {
                jerk: (random(&mut rng, 320.0) * UNITS) as i64,
                duration: (rng.random_range(0.0..0.1) * TIME_UNITS) as i64,
            };
            let (_, extremes) = phase.play(start);
            let mut walk = Extremes { q: [start.q; 2], v: [start.v; 2] };
            for n in 0..=400 {
                let at = start.after(phase.jerk, phase.duration / 400 * n);
                walk.q = [walk.q[0].min(at.q), walk.q[1].max(at.q)];
                walk.v = [walk.v[0].min(at.v), walk.v[1].max(at.v)];
            }
            // Between two of the 400 steps of at most 0.25 ms, the walk misses at most a t^2 / 8 and J t^2 /
            // 8.
            let near = |exact: i64, walked: i64, missed: f64| {
                assert!((exact - walked).abs() as f64 <= missed * UNITS, "{start:?} {phase:?}");
            };
            near(extremes.q[0], walk.q[0], 40.0 * 6.25e-8 / 8.0);
            near(extremes.q[1], walk.q[1], 40.0 * 6.25e-8 / 8.0);
            near(extremes.v[0], walk.v[0], 320.0 * 6.25e-8 / 8.0);
            near(extremes.v[1], walk.v[1], 320.0 * 6.25e-8 / 8.0);
            assert!(extremes.q[0] <= walk.q[0] + 8 && extremes.q[1] >= walk.q[1] - 8);
        }
    }

    #[test]
    fn quantise_refuses_nan_infinite_and_huge_values() {
        for value in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, f64::MAX, 64.1, -64.1] {
            assert_eq!(quantise(value, MOTION_CEILING, UNITS), None);
        }
        assert_eq!(quantise(-0.0, MOTION_CEILING, UNITS), Some(0));
        assert_eq!(quantise(f64::MIN_POSITIVE / 4.0, MOTION_CEILING, UNITS), Some(0));
    }
}
