//! Tests every comparison at its boundary and one unit beyond, on both sides. The constants are written out a
//! second time.

use messages::{JOINTS_MAX, StopPlan};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use robot::JointLimits;

use crate::gate::check::{Check, ConfigError, Limits, comes_to_rest, same_stop};
use crate::gate::fixed::{Phase, Point, TICK, TIME_UNITS, UNITS};
use crate::gate::stored::{Phases, Stored, quantised_phases, write_phases};

/// Slack of every comparison, units.
const SLACK: i64 = 64;
/// Velocity and acceleration that count as rest, units: 1e-7 of 2^40, minus the slack.
const REST_SLACK: i64 = 109_887;
/// Largest differences of durations (units of time) and jerks (units) within the same plan.
const SAME_DURATION: i64 = 32_768;
const SAME_JERK: i64 = 1_048_576;

/// 2 rad, 1.5 rad/s, 8 rad/s^2, 320 rad/s^3, and 0.25 s to stop.
const LIMITS: Limits = Limits { q: [-(2 << 40), 2 << 40], v: 3 << 39, a: 8 << 40, jerk: 320 << 40, stop: 1 << 46 };

const NONE: Phases = [Phase { jerk: 0, duration: 0 }; 3];

/// Checks rest, the length of a stop, and the limits on its way, to the unit.
#[test]
fn stop_bounds_are_exact_to_the_unit() {
    let limits = LIMITS;
    let rest = |from: Point, phases: &Phases| limits.stop(from, phases).map(|stop| stop.end().q);
    for sign in [-1, 1] {
        for (left, rests) in [(0, true), (REST_SLACK, true), (REST_SLACK + 1, false)] {
            for point in [Point { q: 5, v: sign * left, a: 0 }, Point { q: 5, v: 0, a: sign * left }] {
                assert_eq!(rest(point, &NONE), rests.then_some(5).ok_or(Check::Braking), "{point:?}");
            }
        }
        let still = Point { q: limits.q[1] * sign + sign * SLACK, v: 0, a: 0 };
        let waiting = |duration: i64, jerk: i64| [Phase { jerk, duration }, Phase::default(), Phase::default()];
        assert_eq!(rest(still, &waiting(limits.stop, 0)), Ok(still.q));
        assert_eq!(rest(still, &waiting(limits.stop + 1, 0)), Err(Check::Braking));
        let beyond = Point { q: still.q + sign, ..still };
        assert_eq!(rest(beyond, &waiting(limits.stop, 0)), Err(Check::PlanLimits));
        // One unit of time (4 fs) of the jerk changes too little to see. The jerk is judged all the same.
        let centre = Point::default();
        let most = sign * (limits.jerk + SLACK);
        assert_eq!(rest(centre, &waiting(1, most)), Ok(0));
        assert_eq!(rest(centre, &waiting(1, most + sign)), Err(Check::PlanLimits));
        assert_eq!(rest(centre, &waiting(0, most + sign)), Ok(0), "no time, no jerk");
    }
}

/// The time-optimal stop in closed form, in `f64` as a sender computes it. Returns jerk and duration of its phases.
fn sent_stop(v: f64, a: f64, a_max: f64, j_max: f64) -> [(f64, f64); 3] {
    let side = if v + a * a.abs() / (2.0 * j_max) < 0.0 { -1.0 } else { 1.0 };
    let (v, a) = (side * v, side * a);
    let free = (j_max * v + a * a / 2.0).max(0.0).sqrt();
    let peak = free.min(a_max);
    let first_s = (a + peak).abs() / j_max;
    let left = v + first_s * (a - peak) / 2.0 - peak * peak / (2.0 * j_max);
    let cruise_s = if free > a_max { (left / peak).max(0.0) } else { 0.0 };
    let first = if a + peak < 0.0 { j_max } else { -j_max };
    [(side * first, first_s), (0.0, cruise_s), (side * j_max, peak / j_max)]
}

/// An honest stop leaves only rounding at its end, each number to its unit.
#[test]
fn honest_stop_leaves_under_a_thousandth_of_rest_slack() {
    let mut rng = Pcg64::seed_from_u64(36);
    let mut most = 0;
    for n in 0..1_000_000 {
        // The lift, an arm's first joint, and the steepest one.
        let (v_max, a_max, j_max) = [(0.07, 0.15, 12.0), (0.68, 2.45, 320.0), (3.0, 10.0, 400.0)][n % 3];
        let (v, a) = (v_max * rng.random_range(-1.0..=1.0), a_max * rng.random_range(-1.0..=1.0));
        let start = Point::quantised(1.0, v, a).expect("finite");
        let phases = sent_stop(v, a, a_max, j_max).map(|(jerk, duration_s)| Phase {
            jerk: (jerk * UNITS).round() as i64,
            duration: (duration_s * TIME_UNITS).round() as i64,
        });
        let end = phases.iter().fold(start, |point, phase| point.after(phase.jerk, phase.duration));
        most = most.max(end.v.abs()).max(end.a.abs());
    }
    assert!(1000 * most < REST_SLACK, "{most} units");
}

/// Checks the share of the velocity limit for every pair of velocities, with both signs, to the unit.
#[test]
fn permitted_share_of_speed_is_exact_to_the_unit() {
    let limits = LIMITS;
    let point = |v: i64| Point { q: 0, v, a: 0 };
    let elsewhere = Point { q: 1000 + SLACK, v: 0, a: 0 };
    for eighths in 0..=8 {
        let share = limits.v * eighths / 8;
        for last in (-8..=8).map(|n| limits.v * n / 8) {
            for next in (-8..=8).flat_map(|n| [-SLACK - 1, -SLACK, 0, SLACK, SLACK + 1].map(|d| limits.v * n / 8 + d)) {
                let got = limits.slow(point(last), point(next), elsewhere, eighths as f64 / 8.0);
                let may = eighths == 8 || next.abs() <= share + SLACK || next.abs() <= last.abs() + SLACK;
                assert_eq!(got, if may { Ok(()) } else { Err(Check::SpeedScale) }, "{eighths} {last} {next}");
            }
        }
    }
    for scale in [f64::NAN, -1.0, f64::NEG_INFINITY, 0.0, f64::MIN_POSITIVE] {
        assert_eq!(limits.slow(point(100), point(-100 - SLACK), elsewhere, scale), Ok(()));
        assert_eq!(limits.slow(point(100), point(101 + SLACK), elsewhere, scale), Err(Check::SpeedScale));
        // A joint may gain speed as fast as its plan does, because its acceleration cannot vanish at once.
        assert_eq!(limits.slow(point(100), point(101 + SLACK), point(101), scale), Ok(()));
        assert_eq!(limits.slow(point(100), point(102 + SLACK), point(101), scale), Err(Check::SpeedScale));
    }
    assert_eq!(limits.slow(point(0), point(i64::MAX / 4), elsewhere, f64::INFINITY), Ok(()));
}

/// Checks the acceleration at the end of a phase.
#[test]
fn acceleration_within_stop_is_checked_to_the_unit() {
    for sign in [-1, 1] {
        for (beyond, fits) in [(0, true), (SLACK, true), (SLACK + 1, false)] {
            // The acceleration is at the limit for an instant, then falls straight to zero. The velocity is
            // the one this takes: a^2 / 2 J.
            let a = LIMITS.a + beyond;
            let start = Point { q: 0, v: -sign * (64 << 40) / 640, a: sign * a };
            let ramp = Phase { jerk: -sign * LIMITS.jerk, duration: (1 << 48) / 40 };
            let stop = [Phase { jerk: 0, duration: 1 }, ramp, Phase::default()];
            assert_eq!(LIMITS.stop(start, &stop).map(|_| ()), fits.then_some(()).ok_or(Check::PlanLimits), "{beyond}");
        }
    }
}

#[test]
fn seed_with_speed_left_does_not_come_to_rest() {
    let ramp = [Phase { jerk: -(80 << 40), duration: (1 << 48) / 10 }, Phase::default(), Phase::default()];
    for left in [0, REST_SLACK, -REST_SLACK, REST_SLACK + 1, -REST_SLACK - 1] {
        let rests = left.abs() <= REST_SLACK;
        assert_eq!(comes_to_rest(Point { q: 0, v: left, a: 0 }, &NONE), rests, "{left}");
        assert_eq!(comes_to_rest(Point { q: 0, v: 0, a: left }, &NONE), rests, "{left}");
    }
    // The acceleration falls from 8 rad/s^2 at 80 rad/s^3 in 0.1 s. The velocity changes by 0.4 rad/s meanwhile.
    let braked = Point { q: 0, v: -((1_i64 << 40) * 2 / 5), a: 8 << 40 };
    assert!(comes_to_rest(braked, &ramp));
    assert!(!comes_to_rest(Point { v: braked.v + (1 << 30), ..braked }, &ramp));
    assert!(!comes_to_rest(braked, &NONE));
}

#[test]
fn same_stop_may_differ_by_rounding_only() {
    let phase = |jerk: i64, duration: i64| Phase { jerk, duration };
    let (long, jerk) = (1 << 40, 5 << 40);
    let stop = [phase(jerk, long), phase(0, 2 * long), phase(-jerk, 3 * long)];
    for n in 0..3 {
        for sign in [-1, 1] {
            for (duration, other_jerk, same) in [
                (SAME_DURATION, 0, true),
                (SAME_DURATION + 1, 0, false),
                (0, SAME_JERK, true),
                (0, SAME_JERK + 1, false),
                (SAME_DURATION, SAME_JERK, true),
                (SAME_DURATION + 1, SAME_JERK + 1, false),
            ] {
                let mut other = stop;
                other[n].duration += sign * duration;
                other[n].jerk += sign * other_jerk;
                assert_eq!(same_stop(&stop, &other), same, "{n} {duration} {other_jerk}");
                assert_eq!(same_stop(&other, &stop), same, "{n} {duration} {other_jerk}");
            }
        }
    }
    // A phase without duration does not count, at any place and with any jerk.
    let shorter = [stop[1], stop[2], phase(0, 0)];
    let (used_up, barely) = (phase(7 << 40, SAME_DURATION), phase(7 << 40, SAME_DURATION + 1));
    assert!(same_stop(&shorter, &[used_up, stop[1], stop[2]]) && same_stop(&[used_up, stop[1], stop[2]], &shorter));
    assert!(!same_stop(&shorter, &[barely, stop[1], stop[2]]) && !same_stop(&[barely, stop[1], stop[2]], &shorter));
    assert!(!same_stop(&stop, &shorter) && !same_stop(&shorter, &stop) && same_stop(&NONE, &[used_up; 3]));
    assert!(!same_stop(&NONE, &stop) && !same_stop(&stop, &NONE));
}

/// Returns a plan that has one phase of `duration_s` and `jerk` for joint 3.
fn plan_of(jerk: f64, duration_s: f64) -> StopPlan {
    let mut plan = StopPlan { jerk: [[0.0; 3]; JOINTS_MAX], duration_s: [[0.0; 3]; JOINTS_MAX] };
    (plan.jerk[3][1], plan.duration_s[3][1]) = (jerk, duration_s);
    plan
}

#[test]
fn plan_is_quantised_or_refused() {
    let phases = |jerk: f64, duration_s: f64| quantised_phases(&plan_of(jerk, duration_s), 3);
    let middle = |jerk: i64, duration: i64| Some([Phase::default(), Phase { jerk, duration }, Phase::default()]);
    assert_eq!(phases(-1.5, 0.25), middle(-(3 << 39), 1 << 46));
    assert_eq!(phases(1_048_576.0, 16.0), middle(1 << 60, 1 << 52));
    assert_eq!(phases(1.0, -0.1 / TIME_UNITS), middle(1 << 40, 0), "less than half a unit is none");
    assert_eq!(phases(1.0, -1.0 / TIME_UNITS), None);
    for (jerk, duration_s) in [(1_048_576.1, 1.0), (-1_048_576.1, 1.0), (1.0, 16.1), (f64::NAN, 1.0), (1.0, f64::NAN)] {
        assert_eq!(phases(jerk, duration_s), None, "{jerk} {duration_s}");
        assert_eq!(quantised_phases(&plan_of(jerk, duration_s), 4), Some(NONE), "another joint's");
    }
    let mut written = plan_of(0.0, 0.0);
    write_phases(&mut written, 3, &phases(-1.5, 0.25).unwrap_or(NONE));
    assert_eq!(written, plan_of(-1.5, 0.25));
}

/// Checks the played and the remaining part, phase by phase, to the end and beyond.
#[test]
fn stored_plan_is_played_to_its_end() {
    // The acceleration falls from 8 rad/s^2 to zero in 10 ticks. Then 5 ticks and one more tick without jerk follow.
    let jerk = -1500 * (8 << 40) / 10;
    let stop =
        [Phase { jerk, duration: 10 * TICK }, Phase { jerk: 0, duration: 5 * TICK }, Phase { jerk: 0, duration: TICK }];
    let start = Point { q: 1 << 40, v: -(8 << 40) * 5 / 1500, a: 8 << 40 };
    let stored = Stored::new([start; JOINTS_MAX], [stop; JOINTS_MAX]);
    let later = |ticks: u64| {
        let mut later = stored;
        later.play(ticks);
        later
    };
    assert_eq!(stored.joint(2, 0), (start, stop), "nothing is played yet");
    let (third, rest) = stored.joint(2, 3);
    assert_eq!((rest[1], rest[2]), (stop[1], stop[2]));
    assert!((rest[0].duration - 7 * TICK).abs() <= 8 && rest[0].jerk == jerk);
    let near = |x: i64, expected: f64| ((x as f64) - expected * UNITS).abs() < 16.0;
    // a = 8 - 1200 t, v = -4 / 150 + 8 t - 600 t^2, q = 1 - 4 t / 150 + 4 t^2 - 200 t^3 at t = 3 ticks.
    let t = 3.0 / 1500.0;
    assert!(near(third.a, 8.0 - 1200.0 * t) && near(third.v, -4.0 / 150.0 + 8.0 * t - 600.0 * t * t), "{third:?}");
    assert!(near(third.q, 1.0 - 4.0 * t / 150.0 + 4.0 * t * t - 200.0 * t * t * t), "{third:?}");
    let (_, rest) = stored.joint(2, 12);
    assert!(rest[0].duration == 0 && (rest[1].duration - 3 * TICK).abs() <= 8 && rest[2] == stop[2], "{rest:?}");
    let (end, rest) = stored.joint(2, 17);
    assert!((end.v, end.a) == (0, 0) && rest == NONE, "{end:?} {rest:?}");
    for ticks in [18, 1000, 73_500, u64::MAX] {
        assert_eq!(later(ticks).joint(2, ticks), (end, NONE), "{ticks}");
    }
    assert_eq!(later(2).joint(2, 1), stored.joint(2, 3));
    assert_eq!(later(u64::MAX).played, 73_500);
    // A small speed or acceleration without a stop counts as rest.
    let nearly = Point { q: 5, v: 7, a: -9 };
    assert_eq!(Stored::new([nearly; JOINTS_MAX], [NONE; JOINTS_MAX]).joint(0, 0), (Point { q: 5, v: 0, a: 0 }, NONE));
}

#[test]
fn limits_are_quantised_exactly_or_refused() {
    let sound = JointLimits { q_min: -1.0, q_max: 2.0, v_max: 1.5, a_max: 8.0, j_max: 320.0, effort_max: 40.0 };
    let limits = Limits::new("joint", &sound, 0.0).expect("sound");
    assert_eq!((limits.q, limits.v, limits.a, limits.jerk), ([-(1 << 40), 2 << 40], 3 << 39, 8 << 40, 320 << 40));
    // The stop time is 1.05 (V / A + 2 A / J) and a tick.
    let stop_s = 1.05 * (1.5 / 8.0 + 16.0 / 320.0);
    assert!((limits.stop as f64 - stop_s * TIME_UNITS - TICK as f64).abs() < 2.0, "{}", limits.stop);
    let ceilings =
        JointLimits { q_min: -63.9, q_max: 64.0, v_max: 64.0, a_max: 4096.0, j_max: 1_048_576.0, effort_max: 40.0 };
    assert!(Limits::new("joint", &ceilings, 0.0).is_ok());
    type Damage = fn(&mut JointLimits);
    let cases: [(&str, Damage); 9] = [
        ("q_min", |l| l.q_min = -64.0),
        ("q_max", |l| l.q_max = l.q_min),
        ("q_max", |l| l.q_max = 64.1),
        ("v_max", |l| l.v_max = 0.0),
        ("v_max", |l| l.v_max = 64.1),
        ("a_max", |l| l.a_max = 0.0),
        ("a_max", |l| l.a_max = 4096.1),
        ("j_max", |l| l.j_max = 0.0),
        ("j_max", |l| l.j_max = 1_048_577.0),
    ];
    for (name, damage) in cases {
        let mut limits = sound;
        damage(&mut limits);
        let refused = Limits::new("joint", &limits, 0.0);
        assert!(matches!(refused, Err(ConfigError::Limit { limit, .. }) if limit == name), "{name}: {refused:?}");
    }
}

/// A recovery widens the range to the joint's last position, and no further. It never widens the speed.
#[test]
fn recovery_range_extends_to_last_position_only() {
    let slow = LIMITS.v / 10;
    for sign in [-1, 1] {
        let edge = LIMITS.q[1];
        for beyond in [-10, 0, SLACK - 1, SLACK, SLACK + 1, 1 << 38] {
            let last = Point { q: sign * (edge + beyond), v: 0, a: 0 };
            let limits = LIMITS.recovering(last, slow);
            let far = (edge + beyond - SLACK).max(edge);
            assert_eq!(limits.q, if sign > 0 { [-edge, far] } else { [-far, edge] }, "{beyond}");
            assert_eq!((limits.v, limits.a, limits.jerk, limits.stop), (slow, LIMITS.a, LIMITS.jerk, LIMITS.stop));
            assert_eq!(LIMITS.recovering(last, 2 * LIMITS.v).v, LIMITS.v);
        }
    }
}
