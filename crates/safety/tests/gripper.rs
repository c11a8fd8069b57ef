//! The gate of the grippers.

use messages::{GripperMotion, TICK_S};
use rand::{RngExt, SeedableRng};
use safety::gate::Denial;
use safety::gripper::{Config, tick};

const CONFIG: Config = Config { speed: [2.0, 1.0], acceleration: [20.0, 10.0] };
const HALF: GripperMotion = GripperMotion { closure: [0.5, 0.5], rate: [0.0; 2] };

#[test]
fn motion_within_the_limits_passes_unchanged() {
    let rate = 0.9 * 20.0 * TICK_S;
    let next = GripperMotion { closure: [0.5 + rate * TICK_S / 2.0, 0.5], rate: [rate, 0.0] };
    assert_eq!(tick(&CONFIG, &HALF, &next), (next, None));
}

#[test]
fn f121_what_breaks_a_limit_is_denied_and_brakes() {
    let wrong: [fn(&mut GripperMotion); 8] = [
        |motion| motion.closure[1] = f64::NAN,
        |motion| motion.rate[1] = f64::NAN,
        |motion| motion.closure[1] = 0.6,
        |motion| motion.closure[1] = -0.1,
        |motion| motion.closure[1] = 1.1,
        |motion| motion.rate[1] = 0.1,
        |motion| motion.rate[1] = f64::INFINITY,
        |motion| motion.closure[1] = f64::NEG_INFINITY,
    ];
    for (n, change) in wrong.into_iter().enumerate() {
        let mut next = HALF;
        change(&mut next);
        assert_eq!(tick(&CONFIG, &HALF, &next), (HALF, Some(Denial::Gripper { side: 1 })), "{n}");
    }
    let moving = GripperMotion { closure: [0.5, 0.5], rate: [1.0, 0.0] };
    let (braked, denied) = tick(&CONFIG, &moving, &GripperMotion { closure: [0.7, 0.5], ..moving });
    assert!(denied.is_some() && braked.rate[0] < 1.0 && braked.rate[0] > 0.9, "{braked:?}");
}

#[test]
fn f121_no_proposal_moves_a_gripper_beyond_its_limits() {
    let (mut rng, mut last) = (rand_pcg::Pcg64Mcg::seed_from_u64(3), HALF);
    for _ in 0..200_000 {
        let mut bits = || f64::from_bits(rng.random());
        let mut next = GripperMotion { closure: [bits(), bits()], rate: [bits(), bits()] };
        for side in 0..2 {
            if rng.random_range(0..4) > 0 {
                next.closure[side] = last.closure[side] + rng.random_range(-2.0..2.0) * TICK_S;
                next.rate[side] = last.rate[side] + rng.random_range(-25.0..25.0) * TICK_S;
            }
        }
        let (sent, _) = tick(&CONFIG, &last, &next);
        for side in 0..2 {
            assert!((0.0..=1.0).contains(&sent.closure[side]) && sent.rate[side].abs() <= CONFIG.speed[side] + 1e-6);
            let moved = (sent.closure[side] - last.closure[side]).abs();
            assert!(moved <= CONFIG.speed[side] * TICK_S + 1e-6, "{last:?} {next:?} {sent:?}");
        }
        last = sent;
    }
}
