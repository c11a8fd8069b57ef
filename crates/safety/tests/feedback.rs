//! Tests that implausible measurements are detected, and that sound ones never are.

use crate::support::{JOINTS, MODEL};
use messages::{JOINTS_MAX, TICK_S};
use proptest::prelude::*;
use safety::monitor::{Feedback, Judged, Sample};

/// TIAGo++: a joint of its right arm.
const ELBOW: usize = 10;

/// Turns the joints' positions into measurements.
type Encoders<'a> = dyn Fn(&mut [f64; JOINTS_MAX]) + 'a;

/// A robot that is commanded tick by tick, with its encoders.
#[derive(Clone)]
struct Bench {
    monitor: Feedback,
    k: u64,
    q: [f64; JOINTS_MAX],
    begins: bool,
}

impl Bench {
    fn new() -> Self {
        Self { monitor: Feedback::default(), k: 1000, q: MODEL.home, begins: false }
    }

    /// Goes one tick further at velocities `v`. `encoders` turn the joints' positions into measurements.
    fn step(&mut self, v: &[f64; JOINTS_MAX], encoders: impl Fn(&mut [f64; JOINTS_MAX])) -> Judged {
        self.k += 1;
        for (q, v) in self.q.iter_mut().zip(v) {
            *q += v * TICK_S;
        }
        let mut q_measured = self.q;
        encoders(&mut q_measured);
        let a = &[0.0; JOINTS_MAX];
        let (q_measured, begins) = (&q_measured, self.begins);
        let sample = Sample { k: self.k, q: &self.q, v, a, q_measured, dq_measured: v, begins };
        self.monitor.judge(&MODEL, &sample, 0.0)
    }
}

fn one(joint: usize, v: f64) -> [f64; JOINTS_MAX] {
    std::array::from_fn(|j| if j == joint { v } else { 0.0 })
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 256, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn f053_first_jumped_sample_is_skipped_and_second_is_invalid(
        joint in 0..JOINTS, share in -1.0..1.0_f64, by in 0.02..3.0_f64, up in any::<bool>(), before in 1..50_u32,
    ) {
        let by = if up { by } else { -by };
        let v = one(joint, share * MODEL.limits[joint].v_max);
        let mut bench = Bench::new();
        for _ in 0..before {
            let judged = bench.step(&v, |_| {});
            prop_assert!(!judged.invalid);
        }
        let good = bench.q;
        let judged = bench.step(&v, |q| q[joint] += by);
        prop_assert_eq!(judged, Judged { q_measured: good, invalid: false });
        let mut spike = bench.clone();
        let judged = spike.step(&v, |_| {});
        prop_assert_eq!(judged, Judged { q_measured: spike.q, invalid: false });
        let (second, third) = (bench.step(&v, |q| q[joint] += by), bench.step(&v, |q| q[joint] += by));
        prop_assert!(second.invalid && !third.invalid, "an offset that stays can be reset");
    }

    /// Every motion within the limits is accepted, with noise, and with missing samples now and then.
    #[test]
    fn f051_f052_f053_f056_sound_measurements_are_never_invalid(
        shares in proptest::collection::vec(-1.0..1.0_f64, JOINTS), noise in 0.0..1e-3_f64, lost in 1_u64..9, begins in any::<bool>(),
    ) {
        let mut bench = Bench::new();
        bench.begins = begins;
        let slow = if begins { 0.05 } else { 1.0 };
        let v: [f64; JOINTS_MAX] = std::array::from_fn(|j| shares.get(j).map_or(0.0, |share| slow * share * MODEL.limits[j].v_max));
        for n in 0..600_u64 {
            if n % 50 == 7 {
                bench.k += lost;
                for (q, v) in bench.q.iter_mut().zip(&v) {
                    *q += v * TICK_S * lost as f64;
                }
            }
            let sign = if n % 2 == 0 { noise } else { -noise };
            let judged = bench.step(&v, |q| q.iter_mut().for_each(|q| *q += sign));
            prop_assert!(!judged.invalid, "tick {}", n);
        }
    }
}

#[test]
fn f052_frozen_measurement_of_moving_joint_is_invalid() {
    for joint in 0..JOINTS {
        for share in [0.25, 1.0] {
            let speed = share * MODEL.limits[joint].v_max;
            let travel = if MODEL.prismatic[joint] { 0.004 } else { 0.02 };
            let mut bench = Bench::new();
            bench.step(&one(joint, speed), |_| {});
            let frozen = bench.q[joint];
            let taken = (1..2000).find(|_| bench.step(&one(joint, speed), |q| q[joint] = frozen).invalid);
            // The bound is 50 ms or 0.02 rad, whichever comes later.
            let expected = ((travel / speed / TICK_S) as i32).max(74);
            let taken = taken.unwrap_or_else(|| panic!("joint {joint}: never seen"));
            assert!((expected..=expected + 2).contains(&taken), "joint {joint} at {speed}: {taken}, not {expected}");
        }
        // A robot at rest may measure the same for ever.
        let mut bench = Bench::new();
        assert!((0..3000).all(|_| !bench.step(&[0.0; JOINTS_MAX], |_| {}).invalid));
    }
}

#[test]
fn f054_nan_or_infinite_measurement_is_invalid_at_once() {
    for joint in 0..JOINTS {
        for value in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            let mut bench = Bench::new();
            bench.step(&[0.0; JOINTS_MAX], |_| {});
            assert!(bench.step(&[0.0; JOINTS_MAX], |q| q[joint] = value).invalid);
            assert!(!bench.step(&[0.0; JOINTS_MAX], |_| {}).invalid, "and well again");
        }
    }
}

#[test]
fn f056_wrong_sign_or_swapped_joint_is_invalid_within_0_02_rad() {
    for joint in 0..JOINTS {
        for sign in [-1.0, 1.0] {
            let speed = sign * 0.05 * MODEL.limits[joint].v_max;
            let start = MODEL.home[joint];
            let other = (joint + 7) % JOINTS;
            let wrong: [&Encoders<'_>; 2] = [
                &|q| q[joint] = 2.0 * start - q[joint],
                // The posture is the same on both sides, so that nothing jumps.
                &|q| (q[joint], q[other]) = (start, q[other] + q[joint] - start),
            ];
            for encoders in wrong {
                let mut bench = Bench::new();
                bench.begins = true;
                let seen = (0..2000).find(|_| bench.step(&one(joint, speed), encoders).invalid);
                let travel = (bench.q[joint] - start).abs();
                assert!(seen.is_some() && travel < 0.02, "joint {joint}: {travel} after {seen:?}");
            }
            // A joint that friction holds back by a hundredth of a radian raises no fault.
            let mut bench = Bench::new();
            bench.begins = true;
            let stuck = if MODEL.prismatic[joint] { 0.002 } else { 0.01 };
            for _ in 0..1500 {
                let judged = bench.step(&one(joint, speed), |q| {
                    let way = q[joint] - start;
                    q[joint] = start + way.signum() * (way.abs() - stuck).max(0.0);
                });
                assert!(!judged.invalid, "joint {joint}");
            }
        }
    }
}

/// A joint that still swings when a motion begins may come back against the motion's direction. It is
/// accepted. A wrong sign may look like this only once.
#[test]
fn f056_joint_swinging_back_is_valid_and_wrong_sign_is_not() {
    let start = MODEL.home[ELBOW];
    for sign in [-1.0, 1.0] {
        let v = one(ELBOW, sign * 0.05 * MODEL.limits[ELBOW].v_max);
        let begin = || {
            let mut bench = Bench::new();
            bench.step(&[0.0; JOINTS_MAX], |q| q[ELBOW] += sign * 0.024);
            bench.begins = true;
            bench
        };
        let mut swings = begin();
        for n in 0..1500 {
            let judged = swings.step(&v, |q| q[ELBOW] += sign * (0.024 - 1.6 * (q[ELBOW] - start).abs()).max(0.0));
            assert!(!judged.invalid, "tick {n}");
        }
        let mut wrong = begin();
        let seen = (0..2000).find(|_| wrong.step(&v, |q| q[ELBOW] = 2.0 * start - q[ELBOW] + sign * 0.024).invalid);
        let travel = (wrong.q[ELBOW] - start).abs();
        assert!(seen.is_some() && travel < 0.035, "{travel} after {seen:?}");
    }
}

/// Judges samples of one joint: index, setpoint, speed and measurement. The other joints rest.
fn judged(begins: bool, servo_lag_s: f64, samples: &[(u64, f64, f64, f64)]) -> Vec<bool> {
    let mut monitor = Feedback::default();
    let judge = |&(k, q, v, measured): &(u64, f64, f64, f64)| {
        let (q, v, q_measured) = (one(ELBOW, q), one(ELBOW, v), one(ELBOW, measured));
        let (q_measured, a) = (&q_measured, &[0.0; JOINTS_MAX]);
        let sample = Sample { k, q: &q, v: &v, a, q_measured, dq_measured: &v, begins };
        monitor.judge(&MODEL, &sample, servo_lag_s).invalid
    };
    samples.iter().map(judge).collect()
}

#[test]
fn f052_frozen_bounds_are_exact_to_tick_and_bit() {
    let last_of = |samples: &[(u64, f64, f64, f64)]| judged(false, 0.0, samples).pop().expect("samples");
    assert!(!last_of(&[(1000, 0.0, 0.0, 0.1), (1074, 0.03, 0.0, 0.1)]));
    assert!(last_of(&[(1000, 0.0, 0.0, 0.1), (1075, 0.03, 0.0, 0.1)]));
    assert!(!last_of(&[(1000, 0.0, 0.0, 0.1), (1075, 0.02, 0.0, 0.1)]), "as far as friction holds back");
    // Two samples of one index are no later than one.
    assert!(last_of(&[(1000, 0.0, 0.0, 0.1), (1000, 0.03, 0.0, 0.1), (1075, 0.03, 0.0, 0.1)]));
    // A driver that restarts its count begins from scratch.
    assert!(!last_of(&[(1000, 0.0, 0.0, 0.1), (5, 0.03, 0.0, 0.1), (79, 0.06, 0.0, 0.1)]));
    assert!(last_of(&[(1000, 0.0, 0.0, 0.1), (5, 0.03, 0.0, 0.1), (80, 0.06, 0.0, 0.1)]));
}

#[test]
fn f056_direction_bounds_are_exact_to_the_bit() {
    let way = 1.0 / 64.0;
    let ways = |samples: &[(f64, f64)]| {
        let samples: Vec<_> = (1000..).zip(samples).map(|(k, &(q, measured))| (k, q, 0.0, measured)).collect();
        judged(true, 0.0, &samples)
    };
    assert_eq!(ways(&[(0.0, 0.0), (0.0149, 0.0), (0.015, 0.0)]), [false, false, true], "after 0.015 rad");
    assert_eq!(ways(&[(0.0, 0.0), (way, 0.2 * way)]), [false, false], "a fifth is enough");
    assert_eq!(ways(&[(0.0, 0.0), (way, 0.19 * way)]), [false, true], "less is not");
    // A point equally far away on the other side is no farther. From there it moves away.
    assert_eq!(ways(&[(0.0, way / 2.0), (way, way / 2.0), (2.0 * way, way / 2.0)]), [false, false, true]);
}

#[test]
fn f056_lag_of_sound_servo_is_no_wrong_direction() {
    let lag_s = 0.03;
    let mut samples = vec![(1000, 0.0, 0.0, 0.0)];
    for n in 1..200 {
        let q = 0.25 * TICK_S * n as f64;
        samples.push((1000 + n, q, 0.25, q - lag_s * 0.25));
    }
    assert!(judged(true, lag_s, &samples).iter().all(|invalid| !invalid));
}

#[test]
fn f053_jump_bound_is_exact_to_the_bit() {
    let bound = 3.0 * MODEL.limits[10].v_max * TICK_S + 0.005;
    for (to, off) in [(bound, false), (bound + 1e-12, true)] {
        // The second of two outliers in a row is invalid.
        assert_eq!(judged(false, 0.0, &[(1000, 0.0, 0.0, 0.0), (1001, 0.0, 0.0, to), (1001, 0.0, 0.0, to)])[2], off);
    }
}
