//! The checker counts everything outside the limits and nothing inside them.

use super::{Bench, Judge, K, MODEL, exact, ideal};
use crate::support::{ELBOW, random_posture};
use checker::{Checker, Report, ViolationKind};
use driver::Setpoint;
use messages::{JOINTS_MAX, JointCommand, Layout, Mode, TICK_S};
use rand::SeedableRng;
use rand_pcg::Pcg64;
use robot::Frames;
use world::simulated::{Config, Options};

/// TIAGo++: the joints of its right arm.
const RIGHT_ARM: std::ops::Range<usize> = 10..17;

/// Jerk up, hold the acceleration, jerk down. This is a ramp to a speed and back, at `share` of the limits.
fn ramp(bench: &mut Bench, share: f64) {
    let limits = MODEL.limits[ELBOW];
    let rise_s = limits.a_max / limits.j_max;
    let ticks = (rise_s / TICK_S).ceil();
    let jerk = share * limits.a_max / (ticks * TICK_S);
    assert!(jerk > 0.95 * share * limits.j_max, "not at the limit of jerk: {jerk}");
    for sign in [1.0, -1.0, -1.0, 1.0] {
        bench.drive(ELBOW, sign * jerk, ticks as u64);
    }
}

#[test]
fn motion_at_limits_has_no_violation() {
    let mut bench = Bench::ideal();
    for _ in 0..6 {
        ramp(&mut bench, 0.999);
    }
    assert_eq!(bench.violated(), [""; 0], "{:?}", bench.state.report().first_violation);
    assert!(bench.state.report().steps > 200);
}

#[test]
fn jerk_beyond_its_limit_is_counted() {
    let j_max = MODEL.limits[ELBOW].j_max;
    let mut judge = Judge::ideal();
    judge.drive(ELBOW, j_max, 3);
    assert_eq!(judge.violated(), [""; 0]);
    judge.drive(ELBOW, j_max * (1.0 + 1e-6), 1);
    assert_eq!(judge.violated(), ["jerk"]);
    let violation = judge.report.first_violation.unwrap();
    assert_eq!((violation.kind, violation.k, violation.which), (ViolationKind::Jerk, K + 4, ELBOW));
}

#[test]
fn acceleration_beyond_its_limit_is_counted() {
    let limits = MODEL.limits[ELBOW];
    let mut judge = Judge::ideal();
    let ticks = (limits.a_max / limits.j_max / TICK_S).ceil() as u64;
    let jerk = limits.a_max / (ticks as f64 * TICK_S);
    judge.drive(ELBOW, jerk, ticks);
    assert_eq!(judge.violated(), [""; 0]);
    judge.drive(ELBOW, 1e-3, 1);
    assert_eq!(judge.violated(), ["acceleration"]);
}

/// Accelerations on both sides of the effort limit of the shoulder that lifts the arm.
#[test]
fn torque_beyond_effort_limit_is_counted() {
    const LIFTS: usize = 4;
    let mut initial = MODEL.home;
    initial[3..10].copy_from_slice(&[0.3, 0.0, 1.57, 0.2, 0.0, 0.0, 0.0]);
    let exact = Options { initial: Some(initial), robot: exact(), ..Options::default() };
    let effort = MODEL.limits[LIFTS].effort_max;
    let torque = |judge: &Judge, up: f64| {
        let mut a = [0.0; JOINTS_MAX];
        a[LIFTS] = -up;
        judge.bench.config.driver().torques(&judge.bench.command.q, &[0.0; JOINTS_MAX], &a)[LIFTS].abs()
    };
    let judge = Judge::new(&exact);
    let (still, one) = (torque(&judge, 0.0), torque(&judge, 1.0));
    assert!(one > still && still > 0.5 * effort, "{still} {one}");
    let up = (effort - still) / (one - still);
    for (share, counted) in [(1.0 - 1e-9, 0), (1.0 + 1e-9, 1)] {
        let mut judge = Judge::new(&exact);
        judge.bench.command.k += 1;
        judge.bench.command.a[LIFTS] = -share * up;
        judge.show();
        assert_eq!(judge.report.violations_of(ViolationKind::Torque), counted, "{share}");
        let (largest, joint) = judge.report.largest_torque_share();
        assert!((largest - 1.0).abs() < 1e-8 && joint == LIFTS, "{largest} of joint {joint}");
    }
}

/// The way of the hand from posture to posture, on both sides of the bound.
#[test]
fn hand_faster_than_its_bound_is_counted() {
    let hand = |q: &[f64; JOINTS_MAX]| {
        let mut frames = Frames::default();
        MODEL.forward(q, &mut frames);
        let point = MODEL.speed_points()[usize::from(ELBOW >= RIGHT_ARM.start) * 2 + 1];
        frames.base_from_body[point.body].transform_point(&point.at)
    };
    // It gets faster and faster, so the last step is the fastest.
    let ticks = 60;
    let mut bench = Bench::ideal();
    bench.drive(ELBOW, 40.0, ticks - 1);
    let from = hand(&bench.command.q);
    bench.drive(ELBOW, 40.0, 1);
    let fastest = (hand(&bench.command.q) - from).norm() / TICK_S;
    assert!(fastest > 0.01 && bench.violated() == [""; 0], "{fastest} {:?}", bench.violated());
    for (bound, expected) in [(fastest + 1e-6, vec![]), (fastest - 1e-6, vec!["hand speed"])] {
        let driver = checker::Options { hand_speed_max_m_per_s: bound, ..checker::Options::default() };
        let mut bench = Bench::new(&Options { driver, ..ideal() }, 1);
        bench.drive(ELBOW, 40.0, ticks);
        assert_eq!(bench.violated(), expected, "{bound}");
    }
}

#[test]
fn velocity_peak_within_tick_is_counted() {
    let limits = MODEL.limits[ELBOW];
    // With acceleration a at one end and -a at the other, the speed rises by a^2 / 2J in the middle and returns.
    let a = limits.j_max * TICK_S / 2.0;
    let rise = a * a / (2.0 * limits.j_max);
    for (below, expected) in [(1.01 * rise, vec![]), (0.99 * rise, vec!["velocity"])] {
        let mut judge = Judge::ideal();
        let k = judge.bench.command.k;
        // Only the last step is checked.
        (judge.bench.command.v[ELBOW], judge.bench.command.a[ELBOW]) = (limits.v_max - below, a);
        judge.bench.command.q[ELBOW] += judge.bench.command.v[ELBOW] * TICK_S * 0.5;
        judge.bench.stop(ELBOW);
        judge.bench.command.k += 1;
        judge.show();
        let before = judge.report.violations_of(ViolationKind::Velocity);
        assert_eq!((before, judge.bench.command.k), (0, k + 1));
        judge.drive(ELBOW, -limits.j_max, 1);
        let count = judge.report.violations_of(ViolationKind::Velocity);
        assert_eq!(count > before, !expected.is_empty(), "{below}");
    }
}

#[test]
fn velocity_that_does_not_match_position_change_is_counted() {
    for change in [|c: &mut JointCommand| c.q[ELBOW] += 1e-6, |c: &mut JointCommand| c.v[ELBOW] += 1e-4] {
        let mut judge = Judge::ideal();
        judge.drive(ELBOW, 100.0, 20);
        assert_eq!(judge.violated(), [""; 0]);
        judge.bench.next(ELBOW, 0.0);
        change(&mut judge.bench.command);
        judge.bench.stop(ELBOW);
        judge.show();
        assert_eq!(judge.violated(), ["jerk"]);
    }
}

#[test]
fn position_outside_limits_is_counted() {
    let mut initial = MODEL.home;
    let q_max = MODEL.limits[ELBOW].q_max;
    initial[ELBOW] = q_max - 2e-4;
    let exact = Options { initial: Some(initial), robot: exact(), ..Options::default() };
    let mut judge = Judge::new(&exact);
    judge.drive(ELBOW, 100.0, 20);
    assert!(judge.bench.command.q[ELBOW] < q_max);
    assert!(!judge.violated().contains(&"position"));
    judge.drive(ELBOW, 100.0, 30);
    assert!(judge.bench.command.q[ELBOW] > q_max);
    assert!(judge.violated().contains(&"position"), "{:?}", judge.violated());
}

#[test]
fn clearance_matches_robot_model_and_is_counted_below_bound() {
    let mut rng = Pcg64::seed_from_u64(3);
    let mut frames = Frames::default();
    let (mut below, mut above) = (0, 0);
    for _ in 0..400 {
        let initial = random_posture(&MODEL, &mut rng, 0.01);
        let mut bench = Bench::new(&Options { initial: Some(initial), ..Options::default() }, 1);
        bench.tick(K + 1, None);
        MODEL.forward(&bench.state.follower().motion.q, &mut frames);
        let (expected, _) = MODEL.clearance(&frames);
        let report = bench.state.report();
        assert!((report.min_clearance_m - expected).abs() < 1e-9, "{} {expected}", report.min_clearance_m);
        // A robot that is found there has violated nothing. A motion that leads there has.
        assert_eq!(report.violations_of(ViolationKind::Clearance), 0);
        let mut commanded = Report::default();
        let at = |k, q| Setpoint { k, q, v: [0.0; JOINTS_MAX], a: [0.0; JOINTS_MAX] };
        let mut checker = Checker::new(bench.config.driver(), at(K, MODEL.home));
        checker.step(bench.config.driver(), &mut commanded, &at(K + 1, initial), Mode::Engaged as u32);
        MODEL.forward(&initial, &mut frames);
        let (expected, _) = MODEL.clearance(&frames);
        assert_eq!(commanded.violations_of(ViolationKind::Clearance) > 0, expected < MODEL.d_min_m);
        *(if expected < MODEL.d_min_m { &mut below } else { &mut above }) += 1;
    }
    assert!(below > 20 && above > 20, "{below} below, {above} above");
}

#[test]
fn engage_figures_measure_first_second_only() {
    let v_max = MODEL.limits[ELBOW].v_max;
    let mut bench = Bench::ideal();
    bench.command.mode = Mode::Disengaged as u32;
    bench.drive(ELBOW, 0.0, 10);
    assert_eq!((bench.state.report().engagements, bench.state.report().engage_max_step_rad), (0, 0.0));
    bench.command.mode = Mode::Engaging as u32;
    bench.drive(ELBOW, 30.0, 1);
    let step = 30.0 * TICK_S.powi(3) / 6.0;
    assert!((bench.state.report().engage_max_step_rad - step).abs() < 1e-15);
    bench.drive(ELBOW, 30.0, 29);
    bench.drive(ELBOW, -30.0, 30);
    bench.command.mode = Mode::Engaged as u32;
    bench.drive(ELBOW, 0.0, 1);
    let ratio = bench.command.v[ELBOW] / v_max;
    let measured = bench.state.report().engage_first_second_velocity_ratio;
    assert!((measured - ratio).abs() < 1e-12 && ratio > 0.004, "{measured} {ratio}");
    // Faster after the first second, which is no part of the figure.
    let rest = 1500 - 61;
    bench.drive(ELBOW, 0.0, rest);
    bench.drive(ELBOW, 30.0, 30);
    assert_eq!(bench.state.report().engage_first_second_velocity_ratio, measured);
    assert_eq!(bench.state.report().engagements, 1);
}

#[test]
fn options_out_of_bounds_are_refused_by_name() {
    let error = |options: Options| Config::new(&MODEL, &options).unwrap_err().to_string();
    let driver = checker::Options { silence_ticks: 0, ..checker::Options::default() };
    let silence = error(Options { driver, ..Options::default() });
    assert_eq!(silence, "silence_ticks = 0: must be between 1 and 15000");
    let robot = plant::Options { damping_ratio: f64::NAN, ..plant::Options::default() };
    let nan = error(Options { robot, ..Options::default() });
    assert!(nan.contains("damping_ratio = NaN"), "{nan}");
    let mut initial = MODEL.home;
    initial[ELBOW] = MODEL.limits[ELBOW].q_max;
    let outside = error(Options { initial: Some(initial), ..Options::default() });
    assert!(outside.contains("arm_left_4_joint"), "{outside}");
    assert_eq!(JointCommand::ZERO.mode, Mode::Disengaged as u32);
}
