//! Tests that joints which move otherwise than commanded are detected, and a robot that does not stand still.
//! Sound ones are accepted.

use crate::support::{JOINTS, MODEL, TORSO};
use messages::{JOINTS_MAX, TICK_HZ, TICK_S};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use safety::monitor::{Moved, Movement, Sample};
use std::f64::consts::{PI, TAU};

/// The left elbow.
const ELBOW: usize = 6;
/// Standard deviation of the simulated encoders, rad or m, and of the velocities that the drives report.
const NOISE: f64 = 4.8e-5;
const NOISE_V: f64 = NOISE * TAU * 15.0;
/// Reference speed for the speed errors of a revolute joint that may turn faster, rad/s.
const JUDGED: f64 = 0.82;
/// Largest mean difference of measured and sent speed, as a share of the joint's limit or of the reference speed.
const SHARE: f64 = 0.25;

/// A robot that is commanded, with its encoders and drives.
#[derive(Clone)]
struct Bench {
    monitor: Movement,
    rng: Pcg64,
    k: u64,
    q: [f64; JOINTS_MAX],
    v: [f64; JOINTS_MAX],
    a: [f64; JOINTS_MAX],
}

impl Bench {
    fn new() -> Self {
        let [v, a] = [[0.0; JOINTS_MAX]; 2];
        Self { monitor: Movement::default(), rng: Pcg64::seed_from_u64(3), k: 1000, q: MODEL.home, v, a }
    }

    /// Stands at rest for `ms`.
    fn standing(ms: u64) -> Self {
        let mut bench = Self::new();
        for _ in 0..ms * TICK_HZ / 1000 {
            bench.step(1, |_, _| {});
        }
        bench
    }

    /// Goes `ticks` further. `wrong` changes the measured positions and the reported velocities.
    fn step(&mut self, ticks: u64, wrong: impl FnOnce(&mut [f64; JOINTS_MAX], &mut [f64; JOINTS_MAX])) -> Moved {
        self.k += ticks;
        let dt = ticks as f64 * TICK_S;
        for j in 0..JOINTS {
            self.q[j] += dt * (self.v[j] + dt * self.a[j] / 2.0);
            self.v[j] += dt * self.a[j];
        }
        let mut noisy = |x: f64, by: f64| x + by * (0..12).map(|_| self.rng.random_range(-0.5..0.5)).sum::<f64>();
        let mut q_measured = self.q.map(|q| noisy(q, NOISE));
        let mut dq_measured = self.v.map(|v| noisy(v, NOISE_V));
        wrong(&mut q_measured, &mut dq_measured);
        let Self { k, q, v, a, .. } = self;
        let (q_measured, dq_measured) = (&q_measured, &dq_measured);
        let sample = Sample { k: *k, q, v, a, q_measured, dq_measured, begins: false };
        self.monitor.judge(&MODEL, &sample, 0.0)
    }

    /// Swings joint `j` by `amplitude` about its setpoint. Returns the time until this is a velocity error, s.
    fn swings(&mut self, j: usize, amplitude: f64, hz: f64, ticks: u64, within_s: f64) -> Option<f64> {
        let from = self.k;
        while (self.k - from) as f64 * TICK_S <= within_s {
            let t = (self.k + ticks - from) as f64 * TICK_S;
            let by = |q: &mut [f64; JOINTS_MAX], v: &mut [f64; JOINTS_MAX]| {
                q[j] += amplitude * (TAU * hz * t).sin();
                v[j] += amplitude * TAU * hz * (TAU * hz * t).cos();
            };
            if let Some(joint) = self.step(ticks, by).velocity_error {
                assert_eq!(joint, j, "names the joint");
                return Some(t);
            }
        }
        None
    }
}

/// Share of a swing's speed that a window of 20 ms shows.
fn shown(hz: f64) -> f64 {
    (PI * hz * 0.02).sin() / (PI * hz * 0.02)
}

/// Amplitude of a swing whose mean speed is just at the bound.
fn least_amplitude(j: usize, hz: f64) -> f64 {
    SHARE * MODEL.limits[j].v_max.min(JUDGED) * 2.0_f64.sqrt() / (TAU * hz) / shown(hz)
}

const FREQUENCIES: [f64; 9] = [0.5, 1.0, 2.0, 4.0, 6.0, 8.0, 12.0, 16.0, 20.0];

#[test]
fn f055_swing_of_any_frequency_is_a_velocity_error_in_time() {
    for hz in FREQUENCIES {
        for (amplitude, within_s) in [(0.145, 0.3), (0.145 / 2.0, 0.7), (1.3 * least_amplitude(ELBOW, hz), 1.5)] {
            if amplitude < 1.2 * least_amplitude(ELBOW, hz) {
                continue;
            }
            // The joint is at rest or moves. Samples come at every tick, or at every sixth.
            for (v, ticks) in [(0.0, 1), (0.5, 1), (0.0, 6), (0.5, 6)] {
                let mut bench = Bench::standing(200);
                bench.v[ELBOW] = v;
                let taken_s = bench.swings(ELBOW, amplitude, hz, ticks, 3.0);
                assert!(taken_s.is_some_and(|s| s <= within_s), "{amplitude} rad at {hz} Hz, {v} rad/s: {taken_s:?}");
            }
        }
    }
}

#[test]
fn swing_below_bound_is_no_velocity_error() {
    for j in [ELBOW, TORSO] {
        for hz in FREQUENCIES {
            let mut bench = Bench::standing(200);
            // Over half a swing of 0.5 Hz, the mean of a quarter of a second is nearly the peak.
            let share = if hz < 2.0 { 0.6 } else { 0.8 };
            assert_eq!(bench.swings(j, share * least_amplitude(j, hz), hz, 1, 5.0), None, "joint {j} at {hz} Hz");
        }
    }
}

#[test]
fn f055_joint_beyond_its_speed_limit_is_a_velocity_error() {
    for j in 0..JOINTS {
        let v_max = MODEL.limits[j].v_max;
        for (share, within_ms) in [(1.05, 0), (1.6, 40), (2.5, 35)] {
            for lying in [None, Some(0.0), Some(10.0)] {
                let mut bench = Bench::standing(200);
                bench.v[j] = v_max;
                let from = bench.k;
                let taken = (0..TICK_HZ).find(|n| {
                    let by = (share - 1.0) * v_max * *n as f64 * TICK_S;
                    let wrong = |q: &mut [f64; JOINTS_MAX], v: &mut [f64; JOINTS_MAX]| {
                        q[j] += by;
                        v[j] = lying.map_or(share * v_max, |share| share * v_max);
                    };
                    bench.step(1, wrong).velocity_error.is_some()
                });
                let taken_ms = taken.map(|_| (bench.k - from) * 1000 / TICK_HZ);
                let right =
                    if within_ms == 0 { taken_ms.is_none() } else { taken_ms.is_some_and(|ms| ms <= within_ms) };
                assert!(right, "joint {j} at {share} of its limit, reported {lying:?}: {taken_ms:?} ms");
            }
        }
    }
}

#[test]
fn wrong_reported_velocity_is_no_error_but_denies_rest() {
    for lie in [10.0, -10.0, f64::NAN] {
        let mut bench = Bench::standing(300);
        let mut last = Moved::default();
        for _ in 0..3 * TICK_HZ {
            last = bench.step(1, |_, v| v[ELBOW] = lie);
            assert_eq!((last.velocity_error, last.standstill_lost), (None, None), "{lie}");
        }
        assert!(!last.at_rest && last.restless == ELBOW, "{lie}: {last:?}");
    }
}

#[test]
fn single_wrong_position_is_no_velocity_error_after_any_gap() {
    for gap in [1, 5, 30, 300] {
        let mut bench = Bench::standing(200);
        for _ in 0..20 {
            // This is the largest spike that is not skipped as a jump: three times the distance that the
            // joint can move, plus 5 mrad.
            let spike = 3.0 * MODEL.limits[ELBOW].v_max * gap as f64 * TICK_S + 0.005;
            let moved = bench.step(gap, |q, _| q[ELBOW] += spike);
            assert_eq!((moved.velocity_error, moved.standstill_lost), (None, None), "gap of {gap}");
            for _ in 0..TICK_HZ {
                let moved = bench.step(1, |_, _| {});
                assert_eq!((moved.velocity_error, moved.standstill_lost), (None, None), "after a gap of {gap}");
            }
        }
    }
}

/// Full speed to and fro. The servo lags by 10 ms more than is known, overshoots by 5 % and errs by 3 mrad of friction.
#[test]
fn servo_with_lag_and_friction_is_no_velocity_error() {
    let mut bench = Bench::standing(200);
    let (v_max, a_max) = (MODEL.limits[ELBOW].v_max, MODEL.limits[ELBOW].a_max);
    let (mut up, mut friction) = (true, 0.0_f64);
    for n in 0..20 * TICK_HZ {
        up = if n.is_multiple_of(TICK_HZ) { !up } else { up };
        let aim = if up { v_max } else { -v_max };
        bench.a[ELBOW] = ((aim - bench.v[ELBOW]) / TICK_S).clamp(-a_max, a_max);
        let (v, a) = (bench.v[ELBOW], bench.a[ELBOW]);
        // The friction gives way within 50 ms.
        friction += (3e-3 * -v.signum() - friction) / 75.0;
        let off = friction - 0.01 * v;
        let moved = bench.step(1 + u64::from(n.is_multiple_of(100)) * (n % 11), |q, dq| {
            q[ELBOW] += off;
            dq[ELBOW] += 0.05 * v - 0.01 * a;
        });
        assert_eq!((moved.velocity_error, moved.standstill_lost), (None, None), "tick {n}");
    }
}

#[test]
fn nan_or_infinite_position_is_a_velocity_error_at_once() {
    for value in [f64::NAN, f64::INFINITY] {
        let mut bench = Bench::standing(300);
        let moved = bench.step(1, |q, _| q[ELBOW] = value);
        assert_eq!((moved.velocity_error, moved.at_rest), (Some(ELBOW), false));
        assert_eq!(bench.step(1, |_, _| {}).velocity_error, None, "and well again");
    }
}

/// Number of ticks until the monitor reports that the robot is at rest.
fn rest_after(bench: &mut Bench, mut wrong: impl FnMut(u64, &mut [f64; JOINTS_MAX])) -> Option<u64> {
    (0..3 * TICK_HZ).find(|&n| bench.step(1, |q, _| wrong(n, q)).at_rest)
}

#[test]
fn f055_robot_is_at_rest_after_100_ms_of_standstill() {
    let tenth = TICK_HZ / 10;
    let taken = rest_after(&mut Bench::new(), |_, _| {});
    assert!(taken.is_some_and(|n| (tenth..tenth + 3).contains(&n)), "{taken:?}");
    // A joint that continues at 0.67 rad/s is not at rest. A joint that swings is not either, if it is faster
    // than half of what stops or moves by more than 5 mrad in 100 ms.
    for j in [ELBOW, TORSO] {
        let share = if j == TORSO { 0.2 } else { 1.0 };
        assert_eq!(rest_after(&mut Bench::new(), |n, q| q[j] += share * 0.67 * n as f64 * TICK_S), None, "joint {j}");
        for hz in FREQUENCIES {
            let amplitude = (0.8 * least_amplitude(j, hz)).max(share * 0.003);
            let amplitude = if hz < 4.0 { share * 0.145 } else { amplitude };
            let by = |n: u64| amplitude * (TAU * hz * n as f64 * TICK_S).sin();
            let mut bench = Bench::new();
            for n in 0..2 * TICK_HZ {
                bench.step(1, |q, _| q[j] += by(n));
            }
            assert_eq!(rest_after(&mut bench, |n, q| q[j] += by(n)), None, "joint {j} at {hz} Hz");
        }
    }
    // A servo that settles at 5 Hz is at rest once it has settled.
    let taken = rest_after(&mut Bench::new(), |n, q| {
        let t = n as f64 * TICK_S;
        q[ELBOW] += 0.03 * (-0.5 * TAU * 5.0 * t).exp() * (TAU * 5.0 * t).cos();
    });
    assert!(taken.is_some_and(|n| n < TICK_HZ / 2), "{taken:?}");
    // A joint whose command moves is not at rest.
    let mut bench = Bench::new();
    bench.v[ELBOW] = 1e-3;
    assert_eq!(rest_after(&mut bench, |_, _| {}), None);
}

/// Number of ticks until standstill is lost, within 3 s. None if it is not lost.
fn lost_after(bench: &mut Bench, mut wrong: impl FnMut(u64, &mut [f64; JOINTS_MAX])) -> Option<u64> {
    (0..3 * TICK_HZ).find(|&n| bench.step(1, |q, _| wrong(n, q)).standstill_lost.is_some())
}

#[test]
fn f055_joint_that_leaves_its_position_loses_standstill() {
    for j in 0..JOINTS {
        let share = if j == TORSO { 0.2 } else { 1.0 };
        assert_eq!(lost_after(&mut Bench::standing(300), |_, _| {}), None);
        let creep = lost_after(&mut Bench::standing(300), |n, q| q[j] += share * 0.019 * (n as f64 / 4500.0));
        assert_eq!(creep, None, "joint {j} creeps by 19 mrad");
        // The joint sinks at 0.05 rad/s, so 20 mrad take 0.4 s.
        let mut bench = Bench::standing(300);
        let sunk = lost_after(&mut bench, |n, q| q[j] += share * 0.05 * n as f64 * TICK_S);
        assert!(sunk.is_some_and(|n| (590..660).contains(&n)), "joint {j}: {sunk:?}");
        assert_eq!(bench.step(1, |q, _| q[j] += share * 0.021).standstill_lost, Some(j), "and is named");
        // It keeps sinking, at any speed above what the band of a second allows.
        let sinks = |bench: &mut Bench, v: f64| {
            (1..9000).all(|n| {
                let by = share * (0.021 + v * n as f64 * TICK_S);
                bench.step(1, |q, _| q[j] += by).standstill_lost.is_some()
            })
        };
        assert!(sinks(&mut bench.clone(), 0.05) && sinks(&mut bench.clone(), 0.007), "joint {j}");
        // It stands again, at another place. After a second that is its place.
        let stands = (0..2 * TICK_HZ).find(|_| bench.step(1, |q, _| q[j] += share * 0.021).standstill_lost.is_none());
        assert!(stands.is_some_and(|n| (TICK_HZ * 9 / 10..TICK_HZ * 5 / 4).contains(&n)), "joint {j}: {stands:?}");
    }
}

#[test]
fn f055_swing_after_stop_loses_standstill() {
    for hz in FREQUENCIES {
        for amplitude in [0.145, 0.03] {
            let by = |n: u64| amplitude * (TAU * hz * n as f64 * TICK_S).sin();
            let taken = lost_after(&mut Bench::standing(300), |n, q| q[ELBOW] += by(n));
            assert!(taken.is_some_and(|n| n < TICK_HZ / 2), "{amplitude} rad at {hz} Hz: {taken:?}");
        }
        // A joint never comes to rest, though its swing is too small to be far from anywhere. Standstill is
        // lost after the time to settle.
        let by = |n: u64| 0.006 * (TAU * hz * n as f64 * TICK_S).sin();
        let taken = lost_after(&mut Bench::new(), |n, q| q[ELBOW] += by(n));
        assert!(hz < 8.0 || taken.is_some_and(|n| n <= 2 * TICK_HZ + 2), "{hz} Hz: {taken:?}");
    }
}

#[test]
fn servo_settling_after_stop_keeps_standstill() {
    for (hz, damping) in [(15.0, 1.0), (5.0, 0.2), (3.0, 0.5), (10.0, 0.2)] {
        let settles = |n: u64| {
            let t = n as f64 * TICK_S;
            0.04 * (-damping * TAU * hz * t).exp() * (TAU * hz * t).cos() + 0.003 * (1.0 - (-t / 0.5).exp())
        };
        let taken = lost_after(&mut Bench::new(), |n, q| q[ELBOW] += settles(n));
        assert_eq!(taken, None, "{hz} Hz, damping ratio {damping}");
    }
    // A joint that moves on because its command does is not lost.
    let mut bench = Bench::standing(300);
    bench.v[ELBOW] = 0.3;
    assert_eq!(lost_after(&mut bench, |_, _| {}), None);
}

#[test]
fn repeated_sample_or_first_of_new_driver_counts_no_time() {
    let mut bench = Bench::standing(300);
    let again = bench.step(0, |q, _| q[ELBOW] += 1.0);
    assert_eq!((again.sample_ns, again.at_rest, again.velocity_error), (0, true, None));
    assert_eq!(bench.step(3, |_, _| {}).sample_ns, 2_000_000);
    bench.k -= 200;
    let other = bench.step(0, |q, _| q[ELBOW] += 1.0);
    assert_eq!((other.sample_ns, other.at_rest, other.velocity_error), (0, false, None), "nothing is known of it");
}

#[test]
fn wrong_first_sample_of_new_driver_is_no_velocity_error() {
    let mut bench = Bench::standing(300);
    bench.k -= 200;
    // The first sample of another driver is wrong, and nothing indicates it.
    bench.step(0, |q, _| q[ELBOW] += 0.012);
    for n in 0..TICK_HZ {
        assert_eq!(bench.step(1, |_, _| {}).velocity_error, None, "{n} ticks after it");
    }
}
