//! Ten thousand ticks allocate nothing. No content of a skeleton makes a tick panic or leave the limits.

use crate::support::{arm, layers, prediction, random_q, robot, skeleton, weights};
use messages::{Skeleton, Stamp, deadline};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use retarget::{Config, Input, Method, Settings, State, tick};
use rt::count_allocations;

fn config(method: Method, delay_ms: f64) -> Config {
    let settings = Settings { method, following_delay_ms: delay_ms, ..Settings::default() };
    Config::for_arms(&robot(), Some(weights(&layers(1, 6, 128))), &settings)
        .unwrap()
        .with_prediction(Some(prediction()))
}

#[test]
fn tick_with_every_method_and_delay_allocates_nothing() {
    let mut rng = Pcg64::seed_from_u64(31);
    for method in [Method::Network, Method::ClosedForm] {
        for delay_ms in [0.0, 120.0, 250.0] {
            let config = config(method, delay_ms);
            let skeletons: Vec<Skeleton> = (0..700)
                .map(|i| {
                    let at = deadline(3000 + i * 15).0;
                    skeleton(i + 1, at, at, &[random_q(&mut rng, &arm()), random_q(&mut rng, &arm())])
                })
                .collect();
            let mut state = State::default();
            let ((), counted) = count_allocations(|| {
                for k in 3000..13_000_u64 {
                    let newest = Some(&skeletons[(k as usize - 3000) / 15]);
                    std::hint::black_box(tick(&config, &mut state, deadline(k), Input { k, skeleton: newest }));
                }
            });
            assert_eq!(counted.allocated, 0, "{method:?} {delay_ms} ms");
        }
    }
}

/// A hostile number: random bits, or a typical bad value.
fn hostile(rng: &mut Pcg64) -> u64 {
    match rng.random_range(0..6) {
        0 => 0,
        1 => u64::MAX,
        2 => u64::from(f32::NAN.to_bits()),
        3 => u64::from(f32::INFINITY.to_bits()),
        4 => rng.random_range(0..20_000_000_000),
        _ => rng.random(),
    }
}

#[test]
fn random_skeletons_never_panic_or_leave_joint_limits() {
    let mut rng = Pcg64::seed_from_u64(32);
    for method in [Method::Network, Method::ClosedForm] {
        let config = config(method, 120.0);
        let mut state = State::default();
        let mut refused = 0;
        for i in 0..20_000_u64 {
            let now = deadline(i);
            let mut frame = skeleton(i, now.0, now.0, &[random_q(&mut rng, &arm()), random_q(&mut rng, &arm())]);
            if rng.random_bool(0.5) {
                frame.limbs[rng.random_range(0..4)][rng.random_range(0..4)] = f32::from_bits(hostile(&mut rng) as u32);
            }
            match rng.random_range(0..12) {
                0 => frame.received = Stamp(hostile(&mut rng)),
                1 => frame.header.origin = Stamp(hostile(&mut rng)),
                2 => frame.header.sequence = hostile(&mut rng),
                3 => frame.header.incarnation = hostile(&mut rng) as u32,
                4 => frame.flags = hostile(&mut rng) as u32,
                5 => frame.limbs = [[0.0; 4]; 4],
                _ => {}
            }
            let (now, k) = if rng.random_bool(0.01) { (Stamp(hostile(&mut rng)), hostile(&mut rng)) } else { (now, i) };
            let out = tick(&config, &mut state, now, Input { k, skeleton: Some(&frame) });
            refused = out.counters.limbs_refused;
            for (joints, home) in [(3..8, 0.25), (10..15, 0.25)] {
                for (j, joint) in joints.enumerate() {
                    let q = out.target.q[joint];
                    assert!((arm().q_min[j]..=arm().q_max[j]).contains(&q) || q == home, "joint {joint} at {q}");
                    assert!(out.target.dq[joint].abs() <= 2.35);
                }
            }
            assert!(out.target.human_limbs.iter().flatten().all(|x| x.is_finite()));
            // Each limb of the trajectory is a rotation or zero.
            for limb in out.target.limb_trajectory.iter().flatten() {
                let norm: f32 = limb.iter().map(|x| x * x).sum();
                assert!(*limb == [0.0; 4] || (norm - 1.0).abs() < 1e-5, "{limb:?}");
            }
        }
        assert!(refused > 1000, "the hostile limbs were counted: {refused}");
    }
}
