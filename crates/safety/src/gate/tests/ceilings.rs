//! Tests the arithmetic at its ceilings: every value fits its type, and the results agree with the formulas.

use crate::gate::check::{Check, Limits, comes_to_rest, same_stop};
use crate::gate::fixed::{Phase, Point, TICK, ticks_long};

/// Ceilings of `fixed`, written out a second time, in units. A clamped value is one unit beyond.
const MOTION: i64 = 1 << 46;
const ACCELERATION: i64 = 1 << 52;
const JERK: i64 = 1 << 60;
const TIME: i64 = 1 << 52;

/// Returns zero, one, and values on both sides of a ceiling, with both signs.
fn values_near(ceiling: i64, clamped: bool) -> Vec<i64> {
    let beyond = if clamped { ceiling + 1 } else { ceiling };
    [0, 1, ceiling / 3, ceiling - 1, ceiling, beyond].into_iter().flat_map(|x| [x, -x]).collect()
}

fn clamp(value: i128, ceiling: i64) -> i128 {
    let beyond = i128::from(ceiling) + 1;
    value.clamp(-beyond, beyond)
}

/// Returns x / y to the nearest integer, halves upwards.
fn divided(x: i128, y: i128) -> i128 {
    (2 * x + y).div_euclid(2 * y)
}

/// Durations up to the ceiling. They are whole multiples of 2^32 units, so that the cubic fits `i128`.
const TIMES: [i64; 6] = [0, 1, 3, 1 << 10, (1 << 20) - 1, TIME >> 32];

#[test]
fn integration_at_ceilings_matches_clamped_formula() {
    for q in values_near(MOTION, true) {
        for v in values_near(MOTION, true) {
            for a in values_near(ACCELERATION, true) {
                for end in values_near(ACCELERATION, true) {
                    for m in TIMES {
                        let got = Point { q, v, a }.reaching(end, m << 32);
                        let [q, v, a, end, m] = [q, v, a, end, m].map(i128::from);
                        // t / 2^48 = m / 2^16 s.
                        let exact_v = clamp(v + divided((a + end) * m, 1 << 17), MOTION);
                        let exact_q =
                            clamp(q + divided(6 * v * m * (1 << 16) + (2 * a + end) * m * m, 6 << 32), MOTION);
                        assert_eq!(i128::from(got.v), exact_v, "{q} {v} {a} {end} {m}");
                        // The second product uses a rounded first one. The error is half a unit of velocity
                        // for up to 16 s.
                        assert!((i128::from(got.q) - exact_q).abs() <= 2, "{} {exact_q}: {q} {v} {a} {end} {m}", got.q);
                        assert_eq!(i128::from(got.a), end);
                    }
                }
            }
        }
    }
}

#[test]
fn acceleration_at_ceilings_matches_clamped_formula() {
    for a in values_near(ACCELERATION, true) {
        for jerk in values_near(JERK, false) {
            for t in [0, 1, TICK, TIME / 3, TIME - 1, TIME] {
                let got = Point { q: 0, v: 0, a }.after(jerk, t).a;
                let exact = i128::from(a) + divided(i128::from(jerk) * i128::from(t), 1 << 48);
                assert_eq!(i128::from(got), clamp(exact, ACCELERATION), "{a} {jerk} {t}");
            }
        }
    }
}

/// An overflow would end the test: this workspace's profiles turn overflow checks on for this crate.
#[test]
fn checks_at_ceilings_never_overflow() {
    let widest = Limits { q: [-MOTION, MOTION], v: MOTION, a: ACCELERATION, jerk: JERK, stop: 3 * TIME };
    let least = Limits { q: [0, 1], v: 1, a: 1, jerk: 1, stop: TICK };
    let points: Vec<Point> = values_near(MOTION, true)
        .into_iter()
        .flat_map(|q| values_near(MOTION, true).into_iter().map(move |v| (q, v)))
        .flat_map(|(q, v)| values_near(ACCELERATION, true).into_iter().map(move |a| Point { q, v, a }))
        .step_by(13)
        .collect();
    for limits in [widest, least] {
        for last in &points {
            for next in &points {
                let got = limits.step(*last, *next, *last);
                let outside = next.q > limits.q[1] + 64 || next.q < limits.q[0] - 64;
                assert!(!outside || got.is_err(), "{last:?} {next:?}");
                for scale in [0.0, 1e-300, 0.5, 1.0 - f64::EPSILON] {
                    let _ = limits.slow(*last, *next, *last, scale);
                }
            }
            for jerk in values_near(JERK, false) {
                for duration in [0, 1, TICK, TIME] {
                    let stop = [Phase { jerk, duration }, Phase { jerk: -jerk, duration }, Phase { jerk, duration }];
                    let rests = comes_to_rest(*last, &stop);
                    let judged = limits.stop(*last, &stop);
                    assert!(judged.is_err() || rests, "{last:?} {stop:?}: a stop that the gate takes rests");
                    assert!(same_stop(&stop, &stop));
                }
            }
        }
    }
    let at_rest = Point { q: MOTION, v: 0, a: 0 };
    let waiting = [Phase { jerk: 0, duration: TIME }; 3];
    let end = |limits: Limits| limits.stop(at_rest, &waiting).map(|stop| stop.end().q);
    assert_eq!(end(widest), Ok(MOTION), "the longest plan there is");
    let longer = Limits { stop: 3 * TIME - 1, ..widest };
    assert_eq!(end(longer), Err(Check::Braking));
}

/// The turning point of a phase lies within its reported extremes, at any size.
#[test]
fn extremes_at_ceilings_contain_every_velocity_between() {
    for v in values_near(MOTION, true) {
        for a in values_near(ACCELERATION, true) {
            for jerk in values_near(JERK, false).into_iter().step_by(3) {
                for duration in [1, TICK, TIME / 1000, TIME] {
                    let start = Point { q: 0, v, a };
                    let (end, extremes) = Phase { jerk, duration }.play(start);
                    assert_eq!(end, start.after(jerk, duration));
                    for n in 0..=16 {
                        let x = start.after(jerk, (i128::from(duration) * n / 16) as i64);
                        let held = extremes.v[0] - 1 <= x.v && x.v <= extremes.v[1] + 1;
                        assert!(held, "{start:?} {jerk} {duration}: {x:?} {extremes:?}");
                    }
                }
            }
        }
    }
}

#[test]
fn tick_durations_are_exact_up_to_longest_plan() {
    for ticks in (0..2000).chain([73_499, 73_500, (1 << 20) - 1, 1 << 20]) {
        let exact = divided(i128::from(ticks) << 48, 1500);
        assert_eq!(i128::from(ticks_long(ticks)), exact);
    }
    assert_eq!(ticks_long(1), TICK);
}
