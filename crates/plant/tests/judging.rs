//! The judge counts every violation and nothing else.

use crate::support::{ELBOW, HANDS, START, TICK_NS, config, rest, setpoint};
use messages::JOINTS_MAX;
use nalgebra::{Matrix3, Vector3};
use plant::{
    Config, JITTER_ALLOWANCE_NS, Judge, Obstacle, Options, Truth, ViolationKind, segment_box, segment_plane,
    segment_segment,
};
use rand::{RngExt, SeedableRng};

const TICK_S: f64 = 1.0 / 1500.0;

fn standing(config: &Config) -> Truth {
    Truth { stamp: START, q: *config.home(), v: [0.0; JOINTS_MAX], tau: [0.0; JOINTS_MAX] }
}

fn looked(config: &Config, truth: &Truth) -> Judge {
    let mut judge = Judge::new(config, config.home());
    judge.look(config, truth);
    judge
}

#[test]
fn joint_beyond_limit_is_counted_by_kind() {
    let config = config(HANDS, &Options::default());
    let joint = &config.body().joints[ELBOW];
    let mut end = *config.home();
    end[ELBOW] = joint.limits.q_max;
    let lag = config.lags(&end, &[0.0; JOINTS_MAX])[ELBOW];
    assert!((0.0001..0.004).contains(&lag), "{lag}");
    type Set = fn(&mut Truth, f64);
    let rows: [(ViolationKind, Set, f64, f64); 4] = [
        (
            ViolationKind::Position,
            |t, x| t.q[ELBOW] = x,
            joint.limits.q_max + 0.9 * lag,
            joint.limits.q_max + 1.1 * lag,
        ),
        (ViolationKind::Velocity, |t, x| t.v[ELBOW] = -x, 1.04 * joint.limits.v_max, 1.06 * joint.limits.v_max),
        (ViolationKind::Effort, |t, x| t.tau[ELBOW] = -x, joint.limits.effort_max, 1.01 * joint.limits.effort_max),
        (ViolationKind::Velocity, |t, x| t.v[ELBOW] = x, 0.0, f64::NAN),
    ];
    for (kind, set, good, bad) in rows {
        for (value, count) in [(good, 0), (bad, 1)] {
            let mut truth = standing(&config);
            set(&mut truth, value);
            let judge = looked(&config, &truth);
            assert_eq!(judge.report().count(kind), count, "{kind:?} {value}");
            if count == 1 {
                let first = judge.report().first.unwrap();
                assert_eq!((first.kind, first.which, first.at), (kind, ELBOW, START));
            }
        }
    }
    let mut truth = standing(&config);
    truth.q[ELBOW] = f64::NAN;
    let report = *looked(&config, &truth).report();
    let counts =
        [ViolationKind::Stop, ViolationKind::Position, ViolationKind::Clearance].map(|kind| report.count(kind));
    assert_eq!(counts, [1; 3], "a position that is no number is nowhere inside");
    truth.q[ELBOW] = joint.urdf.q_min - 1e-6;
    assert_eq!(looked(&config, &truth).report().count(ViolationKind::Stop), 1);
}

#[test]
fn pair_too_close_is_counted_with_its_index() {
    let config = config(HANDS, &Options::default());
    let mut rng = rand_pcg::Pcg64::seed_from_u64(4);
    let (mut close, mut clear) = (0, 0);
    let mut scale = Judge::new(&config, config.home());
    for _ in 0..300 {
        let q = crate::support::uniform(config.body(), &mut rng);
        let (clearance_m, pair) = scale.clearance(&config, &q);
        let judge = looked(&config, &Truth { q, ..standing(&config) });
        let counted = judge.report().count(ViolationKind::Clearance);
        assert_eq!(counted, u64::from(clearance_m < config.body().d_min_m - plant::CLEARANCE_MARGIN_M));
        if counted == 1 && judge.report().total() == 1 {
            assert_eq!(judge.report().first.unwrap().which, pair);
        }
        *(if counted == 1 { &mut close } else { &mut clear }) += 1;
    }
    assert!(close > 20 && clear > 20, "{close} {clear}");
}

#[test]
fn obstacle_too_close_is_counted() {
    let floor = |offset_m| Obstacle::Plane { normal: Vector3::z(), offset_m };
    let table = |x: f64| Obstacle::Box {
        center: Vector3::new(x, 0.0, 0.7),
        r: Matrix3::identity(),
        half_m: Vector3::new(0.3, 0.5, 0.02),
    };
    for (obstacle, violates) in [(floor(0.0), false), (floor(1.2), true), (table(2.0), false), (table(0.5), true)] {
        let config = config(HANDS, &Options { obstacles: vec![obstacle.clone()], ..Options::default() });
        let judge = looked(&config, &standing(&config));
        assert_eq!(judge.report().count(ViolationKind::Clearance) > 0, violates, "{obstacle:?}");
        if violates {
            assert!(judge.report().first.unwrap().which >= config.body().pairs.len());
        }
    }
}

#[test]
fn robot_starting_outside_may_move_inward_only() {
    let config = config(HANDS, &Options { initial_outside: true, ..Options::default() });
    let limit = config.body().joints[ELBOW].limits.q_max;
    let mut truth = standing(&config);
    truth.q[ELBOW] = limit + 0.015;
    let mut judge = Judge::new(&config, &truth.q);
    for (beyond, violations) in
        [(0.015, 0), (0.0152, 0), (0.01, 0), (0.0102, 0), (0.015, 1), (-0.1, 1), (0.0002, 1), (0.01, 2)]
    {
        truth.q[ELBOW] = limit + beyond;
        judge.look(&config, &truth);
        assert_eq!(judge.report().count(ViolationKind::Position), violations, "{beyond}");
    }
}

/// Sends the elbow at `speed` with `ticks` setpoints, one every `every_ns`. Returns the violations of step and change.
fn sent(speed: f64, ticks: u64, every_ns: u64) -> (u64, u64) {
    let config = config(HANDS, &Options::default());
    let mut judge = Judge::new(&config, config.home());
    let (mut q, mut v) = (*config.home(), [0.0; JOINTS_MAX]);
    v[ELBOW] = speed;
    for k in 0..ticks {
        q[ELBOW] += speed * TICK_S;
        judge.received(&config, START.plus_ns(k * every_ns), &setpoint(k, q, v, [0.0; JOINTS_MAX]), k == 0);
    }
    (judge.report().count(ViolationKind::SetpointStep), judge.report().count(ViolationKind::SetpointChange))
}

#[test]
fn setpoints_faster_than_limit_in_wall_time_are_counted() {
    let v_max = config(HANDS, &Options::default()).body().joints[ELBOW].limits.v_max;
    assert_eq!(sent(v_max, 3000, TICK_NS), (0, 0));
    assert!(sent(1.1 * v_max, 3000, TICK_NS).0 > 1000, "a tenth too fast for two seconds");
    assert!(sent(v_max, 3000, TICK_NS * 9 / 10).0 > 1000, "each within the limit, but sent too often");
    assert_eq!(sent(v_max, 3, 0), (0, 0), "three at once are jitter");
    assert!(sent(v_max, 30, 0).0 > 20, "thirty at once are not");
}

#[test]
fn late_setpoints_that_catch_up_are_no_violation() {
    let config = config(HANDS, &Options::default());
    let limits = config.body().joints[ELBOW].limits;
    let mut judge = Judge::new(&config, config.home());
    let (mut q, mut v) = (*config.home(), [0.0; JOINTS_MAX]);
    v[ELBOW] = limits.v_max;
    for k in 0..600_u64 {
        q[ELBOW] += limits.v_max * TICK_S;
        // The sender sleeps for 20 ticks, then sends the due setpoints at once. After that each is up to the
        // allowance late.
        let due = if (100..120).contains(&k) { 120 } else { k };
        let late_ns = if k % 7 == 0 { JITTER_ALLOWANCE_NS / 3 } else { 0 };
        judge.received(&config, START.plus_ns(due * TICK_NS + late_ns), &setpoint(k, q, v, [0.0; JOINTS_MAX]), k == 0);
    }
    assert_eq!(judge.report().total(), 0, "{:?}", judge.report().first);
}

/// Time without motion is not saved up, however seldom the setpoints come.
#[test]
fn jump_after_slow_standing_setpoints_is_counted() {
    let config = config(HANDS, &Options::default());
    let mut judge = Judge::new(&config, config.home());
    let mut q = *config.home();
    for k in 0..100 {
        if k == 99 {
            q[ELBOW] += 0.05;
        }
        judge.received(&config, START.plus_ns(k * 10_000_000), &rest(k, q), k == 0);
    }
    assert_eq!(judge.report().count(ViolationKind::SetpointStep), 1);
}

#[test]
fn jump_of_position_or_velocity_is_counted() {
    let config = config(HANDS, &Options::default());
    let limits = config.body().joints[ELBOW].limits;
    for (dq, dv, expected) in [(0.01, 0.0, (1, 0)), (0.0, 0.1, (0, 1)), (0.0, 0.0, (0, 0))] {
        let mut judge = Judge::new(&config, config.home());
        for k in 0..100 {
            let mut sent = rest(k, *config.home());
            if k >= 50 {
                (sent.q[ELBOW], sent.v[ELBOW]) = (sent.q[ELBOW] + dq, dv);
            }
            judge.received(&config, START.plus_ns(k * TICK_NS), &sent, k == 0);
        }
        let report = judge.report();
        assert_eq!((report.count(ViolationKind::SetpointStep), report.count(ViolationKind::SetpointChange)), expected);
        if let Some(first) = report.first {
            assert_eq!((first.which, first.at), (ELBOW, START.plus_ns(50 * TICK_NS)));
            assert!(first.bound < 0.01 * limits.v_max.max(limits.a_max), "{first:?}");
        }
    }
}

#[test]
fn first_setpoint_after_reaction_is_not_checked_for_a_step() {
    let config = config(HANDS, &Options::default());
    let mut judge = Judge::new(&config, config.home());
    judge.received(&config, START, &rest(0, *config.home()), true);
    let mut q = *config.home();
    q[ELBOW] += 0.2;
    judge.received(&config, START.plus_ns(TICK_NS), &rest(1, q), true);
    assert_eq!(judge.report().total(), 0);
    judge.received(&config, START.plus_ns(2 * TICK_NS), &rest(2, *config.home()), false);
    assert_eq!(judge.report().count(ViolationKind::SetpointStep), 1);
}

#[test]
fn distances_match_robot_model() {
    let mut rng = rand_pcg::Pcg64::seed_from_u64(6);
    let mut point = |size: f64| Vector3::from_fn(|_, _| rng.random_range(-size..=size));
    for n in 0..100_000 {
        let (a, mut d) = (point(1.0), point(if n % 5 == 1 { 1e-9 } else { 1.0 }));
        if n % 4 == 0 {
            // Nearly along an edge of the box.
            (d.y, d.z) = (d.y * 1e-9, if n % 8 == 0 { 0.0 } else { d.z * 1e-9 });
        }
        let other = [point(1.0), point(1.0)];
        // Every third pair is nearly parallel.
        let other = if n % 3 == 0 { [other[0], other[0] + d * 0.7 + point(1e-7)] } else { other };
        let own = segment_segment(&[a, a + d], &other);
        let theirs = robot::segment_distance(&a, &(a + d), &other[0], &other[1]).distance_m;
        assert!((own - theirs).abs() < 1e-9, "{n}: {own} {theirs}");
        let half_m = point(0.5).map(|x| x.abs() + 1e-3);
        let solid = robot::Solid::Box { center: Vector3::zeros(), r: Matrix3::identity(), half_m };
        let (own, theirs) = (segment_box(&[a, a + d], &half_m), solid.segment_distance(&a, &(a + d)));
        assert!((own - theirs).abs() < 1e-9, "{n}: {own} {theirs}");
        let (normal, offset_m) = (point(1.0).normalize(), a.x);
        let solid = robot::Solid::HalfSpace { normal, offset_m };
        assert_eq!(segment_plane(&[a, a + d], &normal, offset_m), solid.segment_distance(&a, &(a + d)));
    }
}
