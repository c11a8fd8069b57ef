//! Conditions for a person to follow: rates, bursts, silence, one arm alone, and sequences that wrap.

use crate::support;

use std::f64::consts::TAU;

use messages::{Skeleton, Stamp, TICK_S, skeleton_flag, target_flag, tick_at};
use nalgebra::{Quaternion, UnitQuaternion};
use proptest::prelude::*;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use retarget::{ArmQ, Config, Input, Method, Output, Settings, State, tick};
use support::{MS, START_NS, skeleton};

const LEFT: u32 = skeleton_flag::LIMB[0] | skeleton_flag::LIMB[1];

fn human(t_s: f64) -> [ArmQ; 2] {
    [std::array::from_fn(|j| [0.1, 0.2, 1.5, 0.9, 0.0][j] + 0.3 * (TAU * 0.5 * t_s + j as f64).sin()); 2]
}

fn config() -> Config {
    support::config(Method::ClosedForm, Settings::default().following_delay_ms)
}

/// A skeleton for every arrival (ms, frames that arrived at once). A reader sees only the newest of a burst.
fn arrivals(at_ms: impl IntoIterator<Item = (f64, u64)>) -> Vec<Skeleton> {
    let mut sequence = 0;
    let one = |(ms, count): (f64, u64)| {
        sequence += count;
        let at = START_NS + (ms * 1e6) as u64;
        skeleton(sequence, at, at, &human(ms * 1e-3))
    };
    at_ms.into_iter().map(one).collect()
}

fn steady(rate_hz: f64, from_ms: f64, to_ms: f64) -> impl Iterator<Item = (f64, u64)> {
    let period_ms = 1000.0 / rate_hz;
    (0..((to_ms - from_ms) / period_ms) as u64).map(move |i| (from_ms + i as f64 * period_ms, 1))
}

/// Outputs of all ticks until `ms`, by milliseconds from the first arrival.
fn run(config: &Config, skeletons: &[Skeleton], ms: u64) -> impl Fn(u64) -> Output + use<> {
    let outputs = support::run_every(1, config, skeletons, ms as f64 * 1e-3);
    move |ms| outputs[(ms * 3 / 2) as usize].1
}

fn follows(output: &Output) -> bool {
    output.target.flags & target_flag::INPUT_FRESH != 0
}

#[test]
fn f024_person_is_followed_after_500_ms_at_15_hz_and_not_below() {
    let config = config();
    for (rate_hz, enough) in
        [(5.0, false), (10.0, false), (14.0, false), (15.0, true), (20.0, true), (30.0, true), (240.0, true)]
    {
        let at = run(&config, &arrivals(steady(rate_hz, 0.0, 5000.0)), 5000);
        assert!((0..490).all(|ms| !follows(&at(ms))), "{rate_hz} Hz");
        assert_eq!((0..4900).any(|ms| follows(&at(ms))), enough, "{rate_hz} Hz");
        // Once the input is steady, the robot follows it at every tick.
        assert!(!enough || (1100..4900).all(|ms| follows(&at(ms))), "{rate_hz} Hz");
    }
    // If the rate falls while the robot follows, it keeps following until the input is stale.
    let falters = steady(60.0, 0.0, 1000.0).chain(steady(12.0, 1000.0, 3000.0)).chain([(3200.0, 1)]);
    let at = run(&config, &arrivals(falters), 3300);
    assert!((600..3000).all(|ms| follows(&at(ms))));
    assert!((3205..3290).all(|ms| !follows(&at(ms))), "one skeleton after silence is not steady");
}

#[test]
fn f021_f025_bursts_after_silence_never_become_fresh() {
    let config = config();
    // 60 Hz at first, then 12 frames at once every 200 ms: as many frames, but each time 100 ms of silence.
    let bursts = steady(60.0, 0.0, 1000.0).chain((0..10).map(|i| (1000.0 + 200.0 * f64::from(i), 12)));
    let at = run(&config, &arrivals(bursts), 3000);
    assert!((600..1100).all(|ms| follows(&at(ms))));
    assert!((1101..2990).all(|ms| !follows(&at(ms))), "once silent, it never becomes steady");
}

#[test]
fn f016_new_person_is_followed_only_after_500_ms() {
    let mut skeletons = arrivals(steady(60.0, 0.0, 3000.0));
    for skeleton in skeletons.iter_mut().filter(|skeleton| skeleton.received > Stamp(START_NS + 1500 * MS)) {
        skeleton.operator_id += 1;
    }
    let at = run(&config(), &skeletons, 3000);
    assert!((520..1495).all(|ms| follows(&at(ms))));
    assert!((1520..1990).all(|ms| !follows(&at(ms))), "nobody has seen for half a second who came");
    assert!((2100..2990).all(|ms| follows(&at(ms))));
    assert_ne!(at(1490).target.session_nonce, at(2100).target.session_nonce);
}

#[test]
fn f015_person_back_within_2_s_is_followed_after_100_ms_and_three_skeletons() {
    for (rate_hz, gap_ms, watched_ms) in [(60.0, 300, 100), (15.0, 300, 133), (60.0, 1800, 100), (60.0, 2300, 500)] {
        let again = 1000 + gap_ms;
        let skeletons = arrivals(steady(60.0, 0.0, 1000.0).chain(steady(rate_hz, again as f64, 4500.0)));
        let at = run(&config(), &skeletons, 4500);
        assert!((1120..again + watched_ms - 5).all(|ms| !follows(&at(ms))), "{gap_ms}");
        assert!((again + watched_ms + 25..4490).all(|ms| follows(&at(ms))), "{gap_ms}");
    }
    // Three skeletons within 10 ms say nothing about what comes, again and again.
    let bursts = (0..10).flat_map(|i| [0.0, 5.0, 10.0].map(|ms| (1300.0 + 200.0 * f64::from(i) + ms, 1)));
    let at = run(&config(), &arrivals(steady(60.0, 0.0, 1000.0).chain(bursts)), 3000);
    assert!((1120..2990).all(|ms| !follows(&at(ms))));
}

#[test]
fn f011_f015_lost_arm_holds_both_and_never_seen_arm_does_not() {
    let config = config();
    let mut skeletons = arrivals(steady(60.0, 0.0, 3000.0));
    for skeleton in &mut skeletons {
        let ms = (skeleton.received.0 - START_NS) / MS;
        if (1000..1080).contains(&ms) || (1500..2000).contains(&ms) {
            skeleton.flags &= !LEFT;
        }
    }
    let at = run(&config, &skeletons, 3000);
    assert!((520..1580).all(|ms| follows(&at(ms))), "80 ms are bridged");
    // The last frame was at 1483 ms, and the robot follows it 120 ms later.
    let frozen = at(1610).target.q[3..8].to_vec();
    assert!((1610..1990).all(|ms| at(ms).target.q[3..8] == frozen[..]), "the arm that is lost stands");
    assert!((1590..2080).all(|ms| !follows(&at(ms))), "and both do after 100 ms, until both are steady again");
    assert!((2120..2990).all(|ms| follows(&at(ms))));

    // A person with one arm from the start is followed. An arm that joins must be steady, too.
    let mut skeletons = arrivals(steady(60.0, 0.0, 3000.0));
    for skeleton in skeletons.iter_mut().filter(|skeleton| skeleton.received < Stamp(START_NS + 1500 * MS)) {
        skeleton.flags &= !LEFT;
    }
    let at = run(&config, &skeletons, 3000);
    assert!((520..1490).all(|ms| follows(&at(ms))));
    assert!((1510..1990).all(|ms| !follows(&at(ms))));
    assert!((2100..2990).all(|ms| follows(&at(ms))));
}

#[test]
fn f015_arm_lost_for_10_s_is_dropped_in_new_session() {
    let config = config();
    let mut skeletons = arrivals(steady(60.0, 0.0, 13_000.0));
    for skeleton in skeletons.iter_mut().filter(|skeleton| skeleton.received > Stamp(START_NS + 1000 * MS)) {
        skeleton.flags &= !LEFT;
    }
    let at = run(&config, &skeletons, 13_000);
    let session = at(900).target.session_nonce;
    assert!((1110..11_000).all(|ms| !follows(&at(ms)) && at(ms).target.session_nonce == session));
    assert_eq!(at(10_900).target.valid_mask, 0b1_1111 << 3 | 0b1_1111 << 10);
    assert_eq!(at(12_000).target.valid_mask, 0b1_1111 << 10, "the left arm is not meant any more");
    let follows_anew = |output: &Output| follows(output) && output.target.session_nonce != session;
    assert!((11_600..12_900).all(|ms| follows_anew(&at(ms))), "by another session");
}

#[test]
fn f017_limb_noise_of_0_05_rad_is_not_amplified() {
    let config = config();
    let mut rng = Pcg64::seed_from_u64(17);
    let (clean, noise_rad) = (arrivals(steady(60.0, 0.0, 3000.0)), 0.05);
    let mut noisy = clean.clone();
    for skeleton in noisy.iter_mut().filter(|skeleton| skeleton.received > Stamp(START_NS + 1000 * MS)) {
        for limb in &mut skeleton.limbs {
            let axis = nalgebra::Vector3::from_fn(|_, _| rng.random_range(-1.0..1.0)).normalize() * noise_rad;
            let [x, y, z, w] = limb.map(f64::from);
            let q = UnitQuaternion::from_scaled_axis(axis) * UnitQuaternion::new_normalize(Quaternion::new(w, x, y, z));
            *limb = [q.i, q.j, q.k, q.w].map(|c| c as f32);
        }
    }
    let (clean, noisy) = (run(&config, &clean, 3000), run(&config, &noisy, 3000));
    let rotation = |q: [f64; 4]| UnitQuaternion::new_normalize(Quaternion::new(q[3], q[0], q[1], q[2]));
    let mut most: f64 = 0.0;
    for ms in 600..2990 {
        for limb in 0..4 {
            let limbs = [&clean, &noisy].map(|at| rotation(at(ms).target.human_limbs[limb]));
            most = most.max(limbs[0].angle_to(&limbs[1]));
        }
        assert!(follows(&noisy(ms)));
        assert!(noisy(ms).target.dq.iter().all(|v| v.abs() <= 2.35), "within the limits of speed");
    }
    assert!(most > 0.2 * noise_rad && most <= noise_rad + 1e-6, "{most} rad of {noise_rad} rad come through");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(20))]

    #[test]
    fn f032_wrapping_sequence_gives_same_targets(before in 0u64..60) {
        let config = config();
        let usual = arrivals(steady(60.0, 0.0, 1500.0));
        let mut wrapping = usual.clone();
        for skeleton in &mut wrapping {
            skeleton.header.sequence = skeleton.header.sequence.wrapping_sub(before + 2);
        }
        let (usual, wrapping) = (run(&config, &usual, 1500), run(&config, &wrapping, 1500));
        for ms in 0..1490 {
            prop_assert_eq!(usual(ms).target.q, wrapping(ms).target.q, "{} ms", ms);
            prop_assert_eq!(usual(ms).target.flags, wrapping(ms).target.flags);
            prop_assert_eq!(usual(ms).counters, wrapping(ms).counters);
        }
    }

    #[test]
    fn f028_skeletons_at_same_time_give_finite_targets(
        seen in prop::collection::vec((0u64..3, 0u64..40, 0u64..3), 1..60),
    ) {
        let config = config();
        let (mut state, mut sequence, mut received, mut origin) = (State::default(), 1, START_NS, START_NS);
        for (k, (by, ms, stamped)) in (tick_at(Stamp(START_NS))..).zip(seen) {
            (sequence, received, origin) = (sequence + by, received + ms / 20 * 10 * MS, origin + stamped * MS);
            let seen = skeleton(sequence, received, origin, &human(ms as f64));
            let out = tick(&config, &mut state, Stamp(received), Input { k, skeleton: Some(&seen) });
            prop_assert!(out.target.q.iter().chain(&out.target.dq).all(|x| x.is_finite()));
            prop_assert!(out.target.dq.iter().all(|v| v.abs() * TICK_S < 0.01));
        }
    }
}
