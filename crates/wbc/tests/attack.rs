//! Tests the stage's guarantees against targets that try to break them.

use crate::support::{D_MIN_M, JOINTS, config, config_of, home, input, limits, made_up, shipped, towards};
use judge::{Attacker, Checker, Robot, Rollout};
use messages::{ALL_JOINTS, JOINTS_MAX, Stamp, TICK_S};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use wbc::{
    Candidate, Input, Interface, JointMotion, JointStop, Options, Permit, PlannedMotion, State, Target, certify_plan,
    certify_rest, tick,
};

fn attack(robot: &Robot, options: Options, seed: u64, ticks: u64, dense: u64) -> Checker<'_> {
    let config = &config_of(robot, options);
    let mut state = State::at_rest(config, robot.home);
    let mut checker = Checker::new(robot, *state.planned());
    let mut attacker = Attacker::new(robot, Pcg64::seed_from_u64(seed));
    for k in 0..ticks {
        attacker.next(k, &state.planned().q);
        let out = tick(config, &mut state, Stamp::NONE, input(k, &attacker));
        checker.command(k, &out.motion, out.on_plan, k.is_multiple_of(dense));
        let exact = (robot.clearance(&out.motion.q) - out.clearance_m).abs();
        assert!(exact < 1e-6 || !k.is_multiple_of(64), "k {k}: reported clearance is off by {exact}");
    }
    checker
}

/// Seeds whose attacks collide within 5,000 ticks if nothing is proved.
const SEEDS: [u64; 5] = [103, 105, 107, 111, 112];

/// `TELEOPD_ATTACK_TICKS` sets more for each seed.
#[test]
fn f040_f041_f045_attack_breaks_no_limit_or_clearance() {
    let ticks = std::env::var("TELEOPD_ATTACK_TICKS").map_or(20_000, |ticks| ticks.parse().expect("a count"));
    let mut least = f64::INFINITY;
    let robot = made_up();
    for seed in SEEDS {
        let checker = attack(&robot, Options::default(), seed, ticks, 300);
        assert_eq!(checker.violations, 0, "seed {seed}: {:#?}", checker.first);
        println!("seed {seed}: least clearance {:.3} mm", checker.clearance_m * 1e3);
        least = least.min(checker.clearance_m);
    }
    assert!(least < D_MIN_M + 2e-4, "no seed came close: {least}");
}

#[test]
fn attack_on_shipped_robot_breaks_no_limit_or_clearance() {
    let robot = Robot::new(shipped());
    assert!(certify_rest(&config_of(&robot, Options::default()), &robot.home).0, "home is clear");
    let checker = attack(&robot, Options::default(), 7, 20_000, 300);
    assert_eq!(checker.violations, 0, "{:#?}", checker.first);
}

/// Also with an interface, whose deviation every pair must keep, and with obstacles. Each 1,000 ticks the driver's state is
/// another posture, often out of limits or in collision, from which the robot recovers for 500 ticks.
#[test]
fn decisions_do_not_depend_on_skipped_pairs() {
    let mut surrounded = shipped();
    surrounded.obstacles = judge::surroundings(0.3);
    let cases = [
        (103, made_up(), Interface::default()),
        (105, made_up(), Interface::JTC_100_HZ),
        (7, Robot::new(surrounded), Interface::default()),
    ];
    for (seed, robot, interface) in cases {
        let (mut rng, mut recovered) = (Pcg64::seed_from_u64(seed), 0);
        let options = [Options::default(), Options::without_skips_for_tests()];
        let [config, thorough] = options.map(|options| config_of(&robot, options.interface(interface)));
        let mut states = [&config, &thorough].map(|config| State::at_rest(config, robot.home));
        let mut attacker = Attacker::new(&robot, Pcg64::seed_from_u64(seed));
        for k in 0..20_000 {
            attacker.next(k, &states[0].planned().q);
            let mut input = input(k, &attacker);
            if k % 1000 == 500 {
                let there = states[0].planned().q.map(|q| if q == 0.0 { q } else { q + rng.random_range(-0.3..0.3) });
                states.iter_mut().for_each(|state| state.reseed(&JointMotion::rest(there)));
            }
            if k % 1000 >= 500 {
                input.permit = Permit::Recover;
            }
            let out = tick(&config, &mut states[0], Stamp::NONE, input);
            assert_eq!(out, tick(&thorough, &mut states[1], Stamp::NONE, input), "seed {seed}, k {k}");
            recovered += u32::from(input.permit == Permit::Recover && out.candidate == Candidate::All);
        }
        assert!(recovered > 100, "seed {seed}: {recovered} steps of recovery");
    }
}

#[test]
fn attack_without_certificate_breaks_clearance() {
    let robot = made_up();
    for seed in SEEDS {
        let checker = attack(&robot, Options::without_certificate_for_tests(), seed, 5_000, u64::MAX);
        assert!(checker.violations > 0 && checker.clearance_m < D_MIN_M, "seed {seed} proves nothing");
        assert!(checker.first.iter().all(|words| words.contains("clearance")), "{:#?}", checker.first);
    }
}

/// A random motion of all joints, with its stop, near the limits of speed and acceleration.
fn random_plan(rng: &mut Pcg64) -> JointMotion {
    let mut planned = JointMotion::rest([0.0; JOINTS_MAX]);
    for (j, l) in limits().iter().enumerate() {
        let mut x = wbc::JointState { q: rng.random_range(l.q_min..=l.q_max), ..Default::default() };
        x.v = l.v_max * rng.random_range(-1.0..=1.0);
        x.a = l.a_max * rng.random_range(-1.0..=1.0);
        planned.set_joint(j, x, JointStop::new(x.v, x.a, l.a_max, l.j_max));
    }
    planned
}

#[test]
fn certified_plan_keeps_clearance_at_every_sample() {
    let config = config(Options::default());
    let mut rng = Pcg64::seed_from_u64(3);
    let robot = made_up();
    let (mut certified, mut close) = (0, 0);
    while certified < 400 {
        let planned = random_plan(&mut rng);
        let verdict = certify_plan(&config, &planned);
        assert!(verdict.evaluations <= 80);
        if verdict.blamed.is_some() {
            continue;
        }
        certified += 1;
        let mut least = f64::INFINITY;
        for q in Rollout::new(&planned).postures(2e-3) {
            least = least.min(robot.clearance(&q));
        }
        assert!(least >= D_MIN_M, "{least} on a certified plan");
        close += u32::from(least < D_MIN_M + 0.02);
    }
    assert!(close > 10, "only {close} plans came near anything");
}

fn wave(t: f64) -> ([f64; JOINTS_MAX], [f64; JOINTS_MAX]) {
    let w = |j: usize| 1.5 + 0.15 * j as f64;
    // The lift is slow, so its sine stays below 0.07 m/s.
    let size = |j: usize| match j {
        0 => 0.01,
        1..JOINTS => 0.12,
        _ => 0.0,
    };
    (
        std::array::from_fn(|j| home()[j] + size(j) * (w(j) * t).sin()),
        std::array::from_fn(|j| size(j) * w(j) * (w(j) * t).cos()),
    )
}

#[test]
fn certificate_does_not_alter_smooth_motion_without_obstacle() {
    let configs = [config(Options::default()), config(Options::without_certificate_for_tests())];
    let mut states = configs.each_ref().map(|c| State::at_rest(c, home()));
    let (mut squares, mut count) = (0.0, 0.0);
    for k in 0..9000 {
        let (q, dq) = wave(k as f64 * TICK_S);
        let target = Target { q: &q, dq: &dq, ddq: &[0.0; JOINTS_MAX], valid_mask: ALL_JOINTS };
        let input = Input { k, target: Some(target), permit: Permit::Follow { speed_scale: 1.0 } };
        let [with, without] = [0, 1].map(|i| tick(&configs[i], &mut states[i], Stamp::NONE, input));
        assert_eq!(with.candidate, Candidate::All);
        for (j, wanted) in q.iter().enumerate().take(JOINTS) {
            assert!((with.motion.q[j] - without.motion.q[j]).abs() < 1e-9, "k {k} joint {j}");
            if k >= 1500 {
                squares += (with.motion.q[j] - wanted).powi(2);
                count += 1.0;
            }
        }
    }
    let rms = (squares / count).sqrt();
    assert!(rms < 2e-3, "{rms} rad RMS");
    println!("smooth tracking {:.3} mrad RMS", rms * 1e3);
}

#[test]
fn scaled_speed_is_never_exceeded_from_rest() {
    let config = config(Options::default());
    let mut rng = Pcg64::seed_from_u64(9);
    let mut state = State::at_rest(&config, home());
    let mut fastest = 0.0_f64;
    for k in 0..1500 {
        let q = limits().map(|l| rng.random_range(l.q_min..=l.q_max));
        let target = Target {
            q: if k % 300 < 150 { &q } else { &home() },
            dq: &[5.0; JOINTS_MAX],
            ddq: &[0.0; JOINTS_MAX],
            valid_mask: ALL_JOINTS,
        };
        let permit = Permit::Follow { speed_scale: 0.05 };
        let out = tick(&config, &mut state, Stamp::NONE, Input { k, target: Some(target), permit });
        for (j, l) in limits().iter().enumerate() {
            fastest = fastest.max(out.motion.v[j].abs() / l.v_max);
        }
    }
    assert!(fastest <= 0.05, "{fastest}");
    assert!(fastest > 0.04, "{fastest}: never tried");
}

#[test]
fn f033_nan_missing_target_or_stop_ends_at_rest_on_plan() {
    let config = config(Options::default());
    let mut state = State::at_rest(&config, home());
    let mut q = home();
    q[5] += 1.0;
    for k in 0..300 {
        tick(&config, &mut state, Stamp::NONE, towards(k, &q));
    }
    assert!(state.planned().v[5].abs() > 0.5, "moving before the nonsense");
    let expected = state.planned().rest_posture();
    let bad = [f64::NAN; JOINTS_MAX];
    let nonsense = Target { q: &bad, dq: &bad, ddq: &[0.0; JOINTS_MAX], valid_mask: ALL_JOINTS };
    let good = towards(0, &q);
    let endings = [
        Input { target: Some(nonsense), ..good },
        Input { target: None, ..good },
        Input { permit: Permit::Stop, ..good },
        Input { permit: Permit::Follow { speed_scale: f64::NAN }, ..good },
    ];
    for (i, input) in endings.into_iter().enumerate() {
        let mut state = state.clone();
        let mut out = tick(&config, &mut state, Stamp::NONE, input);
        for _ in 0..900 {
            out = tick(&config, &mut state, Stamp::NONE, input);
        }
        let off = (0..JOINTS).fold(0.0_f64, |m, j| m.max((out.motion.q[j] - expected[j]).abs()));
        assert!(out.at_rest && off < 1e-9, "ending {i}: off {off}");
    }
}

#[test]
fn still_target_is_reached_at_exact_rest() {
    let config = config(Options::default());
    let mut state = State::at_rest(&config, home());
    let mut q = home();
    q[4] += 0.3;
    q[12] -= 0.2;
    let target = Target { q: &q, dq: &[0.0; JOINTS_MAX], ddq: &[0.0; JOINTS_MAX], valid_mask: ALL_JOINTS & !(1 << 8) };
    let input = Input { target: Some(target), ..towards(0, &q) };
    let mut out = tick(&config, &mut state, Stamp::NONE, input);
    for _ in 0..3000 {
        out = tick(&config, &mut state, Stamp::NONE, input);
    }
    assert!(out.at_rest && out.on_target && out.settled);
    assert!((0..JOINTS).all(|j| (out.motion.q[j] - q[j]).abs() < 1e-8));
}

#[test]
fn other_arm_reaches_target_while_one_is_blocked() {
    let config = config(Options::default());
    let mut state = State::at_rest(&config, home());
    let mut q = home();
    // The target takes the left hand into the chest.
    (q[3], q[4], q[6]) = (1.5, 0.0, 2.3);
    q[13] += 0.5;
    let input = towards(0, &q);
    let mut out = tick(&config, &mut state, Stamp::NONE, input);
    for _ in 0..6000 {
        out = tick(&config, &mut state, Stamp::NONE, input);
    }
    let left_off = (3..10).fold(0.0_f64, |m, j| m.max((out.motion.q[j] - q[j]).abs()));
    let right_off = (10..17).fold(0.0_f64, |m, j| m.max((out.motion.q[j] - q[j]).abs()));
    assert!(left_off > 0.02 && right_off < 1e-3, "left {left_off}, right {right_off}");
    assert!(!out.on_target);
}

#[test]
fn reseeded_state_continues_given_plan() {
    let config = config(Options::default());
    let mut state = State::at_rest(&config, home());
    let mut q = home();
    q[5] += 1.0;
    let input = towards(0, &q);
    for _ in 0..300 {
        tick(&config, &mut state, Stamp::NONE, input);
    }
    let seen = state.planned().advanced(5.0 * TICK_S);
    let mut fresh = State::at_rest(&config, home());
    fresh.reseed(&seen);
    let out = tick(&config, &mut fresh, Stamp::NONE, Input { permit: Permit::Stop, ..input });
    let next = seen.advanced(TICK_S);
    assert_eq!(out.motion, next);
}

#[test]
fn certify_rest_accepts_home_and_refuses_collision() {
    let config = config(Options::default());
    assert!(certify_rest(&config, &home()).0);
    let mut q = home();
    (q[3], q[4], q[6]) = (1.5, 0.0, 2.3);
    let (clear, clearance_m, pair) = certify_rest(&config, &q);
    assert!(!clear && clearance_m < 0.0, "{clearance_m} {pair:?}");
}
