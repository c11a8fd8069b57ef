//! Tests the jerk interval against brute force. Every admitted jerk is safe, and no jerk beyond its ends is.

use crate::support::limits;
use messages::TICK_S;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use wbc::interval::Bounds;
use wbc::{JointState, JointStop};

/// Samples a path. Between samples it adds the instants where, by linear interpolation, velocity or
/// acceleration vanish.
fn judge_path(total: f64, samples: u32, at: &mut dyn FnMut(f64) -> JointState, judge: &mut dyn FnMut(f64, f64, f64)) {
    let mut before: Option<(f64, JointState)> = None;
    for i in 0..=samples {
        let t = total * f64::from(i) / f64::from(samples);
        let x = at(t);
        judge(x.q, x.v, x.a);
        if let Some((t0, x0)) = before {
            for (y0, y1) in [(x0.v, x.v), (x0.a, x.a)] {
                if y0 * y1 < 0.0 {
                    let turn = at(t0 + (t - t0) * y0 / (y0 - y1));
                    judge(turn.q, turn.v, turn.a);
                }
            }
        }
        before = Some((t, x));
    }
}

/// Judges a jerk by samples of the tick and of the stop after it.
fn admissible(b: &Bounds, x: JointState, j: f64) -> bool {
    let mut fits = j.abs() <= b.j_max;
    let mut judge = |q: f64, v: f64, a: f64| {
        fits &= q <= b.q_max && q >= b.q_min && v.abs() <= b.v_max && a.abs() <= b.a_max * (1.0 + 1e-12);
    };
    judge_path(TICK_S, 40, &mut |t| x.after(j, t), &mut judge);
    let next = x.after(j, TICK_S);
    let stop = JointStop::new(next.v, next.a, b.a_max, b.j_max);
    judge_path(stop.total_s(), 400, &mut |t| stop.advance(next, t).0, &mut judge);
    judge(stop.stop_position(next), next.coasting_velocity(b.j_max), 0.0);
    fits
}

/// A state that its own stop keeps within the bounds, often at one of them.
fn state(rng: &mut Pcg64, b: &Bounds) -> Option<JointState> {
    let share = |rng: &mut Pcg64| {
        if rng.random_bool(0.3) { 1.0 } else { rng.random_range(-1.0..=1.0) }
    };
    let mut a = b.a_max * share(rng);
    let mut v = b.v_max * share(rng);
    match rng.random_range(0..4) {
        // The joint is about to reach the highest speed within this tick.
        0 => {
            a = 1.5 * b.j_max * TICK_S * rng.random_range(0.0..1.0);
            v = b.v_max - a * a / (2.0 * b.j_max) - 1e-9;
        }
        // The joint is about to reverse.
        1 => v = -0.6 * a * a.abs() / (2.0 * b.j_max) * rng.random_range(0.0..1.0),
        _ => {}
    }
    if rng.random_bool(0.5) {
        (v, a) = (-v, -a);
    }
    let mut x = JointState { q: 0.0, v, a };
    if x.coasting_velocity(b.j_max).abs() > b.v_max {
        return None;
    }
    let stop = JointStop::new(v, a, b.a_max, b.j_max);
    let (low, high) = stop.extremes(x);
    let near = 10.0_f64.powf(rng.random_range(-10.0..-3.0));
    x.q = match rng.random_range(0..3) {
        0 => b.q_max - high - near,
        1 => b.q_min - low + near,
        _ => rng.random_range(b.q_min..b.q_max),
    };
    (x.q + low >= b.q_min && x.q + high <= b.q_max).then_some(x)
}

#[test]
fn jerk_interval_ends_are_admissible_and_beyond_is_not() {
    let mut rng = Pcg64::seed_from_u64(5);
    let (mut bounded, mut empty, mut tried) = (0, 0, 0);
    while tried < 3000 {
        let b = limits()[[0, 1, 3, 5, 7][rng.random_range(0..5)]];
        let Some(x) = state(&mut rng, &b) else { continue };
        tried += 1;
        let grid = (0..=64).map(|i| b.j_max * (f64::from(i) / 32.0 - 1.0));
        let Some([low, high]) = b.interval(x) else {
            empty += 1;
            assert!(grid.into_iter().all(|j| !admissible(&b, x, j)), "{x:?} in {b:?} has a jerk");
            continue;
        };
        assert!(admissible(&b, x, low) && admissible(&b, x, high), "[{low}, {high}] of {x:?} in {b:?}");
        assert!(b.admits(x, low) && b.admits(x, high) && b.admits(x, 0.5 * (low + high)));
        // Sampling detects a violation later than the exact test, because a parabola may hide between samples.
        let beyond = 2e-2 * b.j_max;
        for j in grid.chain([low - beyond, high + beyond]) {
            let outside = j < low - beyond * 0.999 || j > high + beyond * 0.999;
            assert!(!outside || !admissible(&b, x, j), "{j} outside [{low}, {high}] of {x:?} in {b:?}");
        }
        bounded += u32::from(high - low < 1.999 * b.j_max);
        for wanted in [low - 1.0, high + 1.0, 0.3 * low + 0.7 * high, f64::MAX] {
            let taken = b.nearest_admissible(x, wanted).expect("the interval is not empty");
            assert!((taken - wanted.clamp(low, high)).abs() < 1e-6 * b.j_max, "{wanted} -> {taken} of [{low}, {high}]");
        }
    }
    assert!(bounded > 500, "{bounded} states were bounded by anything but the jerk, {empty} empty");
}
