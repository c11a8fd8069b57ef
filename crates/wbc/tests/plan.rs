//! The stop of a joint in closed form.

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use wbc::{JointState, JointStop};

fn cases() -> Vec<(f64, f64, f64, f64)> {
    let mut rng = Pcg64::seed_from_u64(1);
    let mut out = Vec::new();
    for (v_max, a_max, j_max) in [(2.35, 8.0, 320.0), (0.07, 0.3, 12.0), (3.0, 10.0, 400.0)] {
        let corners = [0.0, 1e-300, -1e-300, 1e-17, -1e-12, 1.0, -1.0, 0.5];
        for v in corners {
            for a in corners {
                out.push((v * v_max, a * a_max, a_max, j_max));
            }
        }
        for _ in 0..20_000 {
            let scale = 10.0_f64.powf(rng.random_range(-9.0..0.0));
            let v = rng.random_range(-1.0..=1.0) * v_max * if rng.random_bool(0.5) { scale } else { 1.0 };
            let a = rng.random_range(-1.0..=1.0) * a_max * if rng.random_bool(0.5) { scale } else { 1.0 };
            out.push((v, a, a_max, j_max));
        }
        for _ in 0..100 {
            // These states lie exactly on the curve where only the acceleration has to vanish.
            let a = rng.random_range(-1.0..=1.0) * a_max;
            out.push((-a * a.abs() / (2.0 * j_max), a, a_max, j_max));
        }
    }
    out
}

#[test]
fn stop_ends_at_rest_within_its_bounds() {
    for (v, a, a_max, j_max) in cases() {
        let stop = JointStop::new(v, a, a_max, j_max);
        let mut x = JointState { q: 0.0, v, a };
        for phase in 0..3 {
            assert!(stop.duration_s[phase] >= 0.0 && stop.duration_s[phase].is_finite(), "{v} {a}: {stop:?}");
            assert!(stop.jerk[phase].abs() <= j_max);
            x = x.after(stop.jerk[phase], stop.duration_s[phase]);
            assert!(x.a.abs() <= a_max * (1.0 + 1e-14), "{v} {a}: {x:?}");
        }
        assert!(x.v.abs() < 4e-15 && x.a.abs() < 2e-14, "{v} {a}: {x:?}");
    }
}

#[test]
fn remaining_stop_equals_new_stop_of_later_state() {
    for (v, a, a_max, j_max) in cases() {
        let x = JointState { q: 0.3, v, a };
        let stop = JointStop::new(v, a, a_max, j_max);
        let (later, left) = stop.advance(x, stop.total_s() * 0.4);
        let again = JointStop::new(later.v, later.a, a_max, j_max);
        assert!((again.total_s() - left.total_s()).abs() < 3e-8, "{v} {a}: {again:?} {left:?}");
        assert!((again.stop_position(later) - stop.stop_position(x)).abs() < 1e-12, "{v} {a}");
    }
}

#[test]
fn stop_tick_by_tick_matches_stop_at_once_and_ends_at_rest() {
    for (v, a, a_max, j_max) in cases().into_iter().step_by(7) {
        let start = JointState { q: 0.0, v, a };
        let stop = JointStop::new(v, a, a_max, j_max);
        let (mut x, mut left) = (start, stop);
        let mut ticks = 0;
        while !left.is_done() {
            (x, left) = left.advance(x, messages::TICK_S);
            ticks += 1;
            assert!(ticks < 2000, "{v} {a}");
        }
        assert!(x.is_at_rest());
        assert!((x.q - stop.stop_position(start)).abs() < 1e-12);
        assert!((stop.advance(start, 10.0).0.q - x.q).abs() < 1e-12);
    }
}

#[test]
fn extremes_match_dense_samples() {
    for (v, a, a_max, j_max) in cases().into_iter().step_by(31) {
        let x = JointState { q: 0.1, v, a };
        let stop = JointStop::new(v, a, a_max, j_max);
        let (low, high) = stop.extremes(x);
        let total = stop.total_s();
        let (mut dense_low, mut dense_high) = (x.q, x.q);
        for i in 0..=2000 {
            let q = stop.advance(x, total * f64::from(i) / 2000.0).0.q;
            (dense_low, dense_high) = (dense_low.min(q), dense_high.max(q));
        }
        // Between samples the position exceeds both by at most |a| dt^2 / 8.
        let gap = a_max * (total / 2000.0).powi(2) / 8.0 + 1e-15;
        assert!(low <= dense_low + 1e-15 && low >= dense_low - gap, "{v} {a}: {low} {dense_low}");
        assert!(high >= dense_high - 1e-15 && high <= dense_high + gap, "{v} {a}: {high} {dense_high}");
    }
}
