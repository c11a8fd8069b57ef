//! Tests which commands the gate accepts, and what it sends in place of the others.

use crate::support::adversary::Adversary;
use crate::support::motion::{NO_PLAN, T, resting, set_joint, set_stopping, stop_from, store};
use crate::support::{JOINTS, model};
use judge::joint::{Joint, Stop};
use messages::{JOINTS_MAX, JointMotion, Stamp, StopPlan};
use rand::{Rng, RngExt, SeedableRng};
use rand_pcg::Pcg64;
use robot::{Frames, JointLimits, Model, Pose};
use safety::clearance::clearance;
use safety::engage::Permit;
use safety::gate::{Check, Config, ConfigError, Decision, Denial, Proposed, State, Verdict, tick};

/// The robot without collision pairs, for tests of joints only.
fn without_pairs() -> Model {
    let mut model = model();
    model.pairs.clear();
    model
}

fn decide(config: &Config, state: &mut State, proposed: Proposed) -> Decision {
    tick(config, state, Stamp(0), proposed)
}

/// All joints rest at home except `j`, which is at `x` with the time-optimal stop.
fn seeded(model: &Model, j: usize, x: Joint) -> (State, Stop) {
    let mut seed = resting(0, model.home);
    let stop = set_stopping(&mut seed, j, x, &model.limits[j]);
    let mut state = State::at_rest(model.home);
    state.reseed(&seed.motion);
    (state, stop)
}

fn with_jerk(model: &Model, j: usize, x: Joint, jerk: f64) -> Proposed {
    let mut next = resting(1, model.home);
    set_stopping(&mut next, j, x.after(jerk, T), &model.limits[j]);
    next
}

fn check_of(decision: &Decision) -> Option<Check> {
    match decision.verdict {
        Verdict::Deny(Denial::Joint { check, .. }) => Some(check),
        _ => None,
    }
}

/// Returns what the judge finds in a tick from `x` to `to`, with the fastest stop after it.
fn wrong(l: &JointLimits, x: Joint, stop: &Stop, to: Joint, grant: f64) -> Option<&'static str> {
    let slack = judge::limits::Slack::for_grant(grant);
    judge::limits::tick(l, x, stop, to, &stop_from(to, l.a_max, l.j_max), slack).map(|breach| breach.what)
}

/// The largest jerk above an admissible one that the judge still accepts with `grant`, found by halving.
fn largest(l: &JointLimits, x: Joint, stop: &Stop, inside: f64, outside: f64, grant: f64) -> f64 {
    let (mut low, mut high) = (inside, outside);
    for _ in 0..60 {
        let middle = (low + high) / 2.0;
        if wrong(l, x, stop, x.after(middle, T), grant).is_none() { low = middle } else { high = middle }
    }
    low
}

/// A state near one of the joint's limits. Its stop, or the fastest point of its stop, just fits.
fn near_a_limit(rng: &mut Pcg64, l: &JointLimits) -> Joint {
    let side = if rng.random_bool(0.5) { 1.0 } else { -1.0 };
    let whole = [1.0 - 1e-3 * rng.random::<f64>(), rng.random_range(-1.0..1.0), 0.0][rng.random_range(0..3)];
    // Every other state turns within its next tick, in speed or in direction.
    let turns = rng.random_bool(0.5);
    let a = side * if turns { l.j_max * T * rng.random_range(-1.0..1.0) } else { l.a_max * whole };
    let peak = a * a.abs() / (2.0 * l.j_max);
    let fastest = l.v_max * [1.0 - 1e-4 * rng.random::<f64>(), 1.0 - 1e-9, rng.random()][rng.random_range(0..3)];
    let turning_back = turns && rng.random_bool(0.5);
    let v = if turning_back { -a * T * rng.random::<f64>() } else { (side * fastest - peak).clamp(-l.v_max, l.v_max) };
    let x = Joint { q: 0.0, v, a };
    let reach = x.play(&stop_from(x, l.a_max, l.j_max), 1e3).q;
    let room = (l.q_max - l.q_min) * [1e-11, 1e-7 * rng.random::<f64>(), 0.3][rng.random_range(0..3)];
    let q = if reach >= 0.0 { l.q_max - reach - room } else { l.q_min - reach + room };
    Joint { q, ..x }
}

/// The gate accepts all that the judge accepts. It refuses what the judge refuses with twice the gate's slack.
#[test]
fn f040_f041_gate_accepts_steps_up_to_largest_admissible() {
    const TWICE_THE_SLACK: f64 = 128.0 / (1_u64 << 40) as f64;
    let model = without_pairs();
    let config = Config::new(&model).unwrap();
    let mut rng = Pcg64::seed_from_u64(11);
    let mut bound_by = std::collections::BTreeMap::<(&str, bool), u32>::new();
    let mut found = 0;
    while found < 20_000 {
        let j = rng.random_range(0..JOINTS);
        let l = &model.limits[j];
        let x = near_a_limit(&mut rng, l);
        let (state, stop) = seeded(&model, j, x);
        let admits = |jerk: f64| wrong(l, x, &stop, x.after(jerk, T), 0.0).is_none();
        let Some(inside) = (-8..=8).map(|n| f64::from(n) / 8.0 * l.j_max).find(|&jerk| admits(jerk)) else {
            continue;
        };
        found += 1;
        for outside in [-1.5 * l.j_max, 1.5 * l.j_max] {
            let exact = largest(l, x, &stop, inside, outside, 0.0);
            let decision = decide(&config, &mut state.clone(), with_jerk(&model, j, x, exact));
            assert!(decision.accepted(), "{:?} at {exact} of {l:?} from {x:?}", decision.verdict);

            let beyond = largest(l, x, &stop, inside, outside, TWICE_THE_SLACK);
            // The first of ever larger steps that the judge sees. A flat limit needs a larger one in `f64`.
            let seen = (0..9).find_map(|n| {
                let jerk = beyond + (outside - inside) * 1e-9 * 10_f64.powi(n);
                wrong(l, x, &stop, x.after(jerk, T), TWICE_THE_SLACK).map(|what| (jerk, what))
            });
            let (beyond, what) = seen.expect("just beyond");
            let decision = decide(&config, &mut state.clone(), with_jerk(&model, j, x, beyond));
            let expected: &[Check] = match what {
                "jerk" => &[Check::Jerk],
                "acceleration" => &[Check::Acceleration],
                "velocity" => &[Check::Velocity],
                "position" => &[Check::Position],
                // If the plan breaks a limit, the state at its beginning may break it too.
                "plan's velocity" | "plan's position" => &[Check::PlanLimits, Check::Velocity, Check::Position],
                "plan's acceleration" => &[Check::PlanLimits],
                other => panic!("{other}"),
            };
            let check = check_of(&decision);
            // Several limits may be broken at once. Then the first one in the gate's order is named.
            let named = check.is_some_and(|check| {
                expected.contains(&check) || matches!(check, Check::Jerk | Check::Acceleration | Check::PlanLimits)
            });
            assert!(named, "{:?}, not {what}, at {beyond} of {l:?} from {x:?}", decision.verdict);
            *bound_by.entry((what, outside > 0.0)).or_default() += 1;
        }
    }
    println!("bound by: {bound_by:?}");
    for what in ["jerk", "acceleration", "velocity", "position", "plan's velocity", "plan's position"] {
        for upwards in [false, true] {
            let bound = bound_by.get(&(what, upwards)).is_some_and(|count| *count > 100);
            assert!(bound, "{what} bound too rarely: {bound_by:?}");
        }
    }
}

#[test]
fn step_off_constant_jerk_beyond_slack_is_denied() {
    let model = without_pairs();
    let config = Config::new(&model).unwrap();
    let x = Joint { q: 0.1, v: 0.2, a: 1.0 };
    let (state, _) = seeded(&model, 1, x);
    let unit = 1.0 / (1_u64 << 40) as f64;
    for (units, accepted) in [(0.0, true), (60.0, true), (70.0, false), (-60.0, true), (-70.0, false)] {
        for field in 0..2 {
            let mut p = with_jerk(&model, 1, x, 10.0);
            let value = if field == 0 { &mut p.motion.q[1] } else { &mut p.motion.v[1] };
            *value += units * unit;
            // The plan of a faster state ends faster by as much. This is below the bound of rest.
            let decision = decide(&config, &mut state.clone(), p);
            assert_eq!(decision.accepted(), accepted, "{units} {field} {:?}", decision.verdict);
            assert!(accepted || check_of(&decision) == Some(Check::Step));
        }
    }
}

#[test]
fn plan_that_ends_moving_or_late_is_denied() {
    let model = without_pairs();
    let config = Config::new(&model).unwrap();
    let (j, x) = (1, Joint { q: 0.0, v: 0.3, a: 0.0 });
    let (state, _) = seeded(&model, j, x);
    let l = &model.limits[j];
    let with = |change: &dyn Fn(&mut StopPlan)| {
        let mut p = with_jerk(&model, j, x, 0.0);
        change(&mut p.motion.plan);
        decide(&config, &mut state.clone(), p)
    };
    assert!(with(&|_| {}).accepted());
    let shorter = |by: f64| move |plan: &mut StopPlan| plan.duration_s[j][2] -= by;
    assert!(with(&shorter(1e-9 / l.j_max)).accepted(), "a billionth of rad/s^2 is left");
    assert_eq!(check_of(&with(&shorter(1e-5 / l.j_max))), Some(Check::Braking));
    assert_eq!(check_of(&with(&|plan| *plan = NO_PLAN)), Some(Check::Braking), "no plan at speed");
    // This stop is so gentle that it takes longer than any stop has to. It would come to rest, but late.
    let longest = (l.v_max / l.a_max + 2.0 * l.a_max / l.j_max).max(model.stop_time_max_s);
    let latest = 1.05 * longest + T;
    for (time, check) in [(latest * 0.999, None), (latest * 1.001, Some(Check::Braking))] {
        let a = x.v / (time / 2.0);
        let jerk = 2.0 * a / time;
        let gentle = [(-jerk, time / 2.0), (jerk, time / 2.0), (0.0, 0.0)];
        assert!(x.play(&gentle, 1e3).q < l.q_max);
        assert_eq!(check_of(&with(&|plan| store(plan, j, &gentle))), check, "{time}");
    }
    let negative = |plan: &mut StopPlan| plan.duration_s[j][1] = -1e-3;
    assert_eq!(check_of(&with(&negative)), Some(Check::Finite));
}

#[test]
fn new_motion_without_permit_is_denied() {
    let model = without_pairs();
    let config = Config::new(&model).unwrap();
    let x = Joint { q: 0.1, v: 0.2, a: 0.0 };
    let (state, stop) = seeded(&model, 1, x);
    let new = Proposed { permit: Permit::Stop, ..with_jerk(&model, 1, x, 0.0) };
    assert_eq!(decide(&config, &mut state.clone(), new).verdict, Verdict::Deny(Denial::Permit));
    let mut along = Proposed { permit: Permit::Stop, ..resting(1, model.home) };
    set_joint(&mut along, 1, x.play(&stop, T));
    store(&mut along.motion.plan, 1, &stop);
    along.motion.plan.duration_s[1][0] -= T;
    assert_eq!(decide(&config, &mut state.clone(), along).verdict, Verdict::OnPlan);
}

#[test]
fn motion_faster_than_permitted_share_is_denied() {
    let model = without_pairs();
    let config = Config::new(&model).unwrap();
    let l = &model.limits[1];
    for (scale, v, accepted) in [
        (0.05, 0.04 * l.v_max, true),
        (0.05, 0.0501 * l.v_max, false),
        (0.5, 0.49 * l.v_max, true),
        (f64::NAN, 0.001, false),
        (-1.0, 0.001, false),
        (f64::INFINITY, 0.9 * l.v_max, true),
    ] {
        let x = Joint { q: 0.1, v, a: 0.0 };
        let (mut state, _) = seeded(&model, 1, x);
        let p = Proposed { permit: Permit::Follow { speed_scale: scale }, ..with_jerk(&model, 1, x, l.j_max / 2.0) };
        let decision = decide(&config, &mut state, p);
        assert_eq!(decision.accepted(), accepted, "{scale} {v} {:?}", decision.verdict);
        assert!(accepted || check_of(&decision) == Some(Check::SpeedScale));
        // Slowing down is always allowed.
        let (mut state, _) = seeded(&model, 1, x);
        let p = Proposed { permit: p.permit, ..with_jerk(&model, 1, x, -l.j_max / 2.0) };
        assert!(decide(&config, &mut state, p).accepted());
    }
}

#[test]
fn repeated_skipped_or_old_index_is_denied() {
    let model = without_pairs();
    let config = Config::new(&model).unwrap();
    let mut state = State::at_rest(model.home);
    assert!(decide(&config, &mut state, resting(100, model.home)).accepted());
    for (k, accepted) in [(101, true), (101, false), (100, false), (102, true), (104, false), (105, true), (0, false)] {
        let decision = decide(&config, &mut state, resting(k, model.home));
        assert_eq!(decision.accepted(), accepted, "{k}");
        assert!(accepted || decision.verdict == Verdict::Deny(Denial::Index));
    }
    assert!(!decide(&config, &mut state, resting(u64::MAX, model.home)).accepted());
}

#[test]
fn invalid_seed_denies_until_a_valid_one_comes() {
    let model = without_pairs();
    let config = Config::new(&model).unwrap();
    let still = [0.0; JOINTS_MAX];
    let mut state = State::at_rest(model.home);
    let mut bad = still;
    bad[3] = f64::NAN;
    let mut moving = still;
    moving[3] = 0.1;
    for (v, a) in [(bad, still), (still, bad), (moving, still)] {
        state.reseed(&JointMotion { v, a, ..JointMotion::rest(model.home) });
        let decision = decide(&config, &mut state, resting(1, model.home));
        assert_eq!(decision.verdict, Verdict::Deny(Denial::Seed));
        assert!(decision.motion.q == state.motion().q && decision.motion.v == still, "stays where it was");
    }
    state.reseed(&JointMotion::rest(model.home));
    assert!(decide(&config, &mut state, resting(7, model.home)).accepted());
    // The robot may be outside its limits. Then it may rest there, but not move.
    let mut outside = model.home;
    outside[1] = model.limits[1].q_max + 0.2;
    state.reseed(&JointMotion::rest(outside));
    assert_eq!(decide(&config, &mut state, resting(1, outside)).verdict, Verdict::OnPlan);
    let from = Joint { q: outside[1], v: 0.0, a: 0.0 };
    let mut out = with_jerk(&model, 1, from, -10.0);
    out.k = 2;
    assert_eq!(check_of(&decide(&config, &mut state, out)), Some(Check::Position));
}

/// A clear posture, a direction, and the distance along it at which the clearance falls to `d_min_m`.
fn towards_collision(model: &Model) -> ([f64; JOINTS_MAX], usize, f64, f64) {
    let mut rng = Pcg64::seed_from_u64(5);
    let mut frames = Frames { base_from_body: [Pose::identity(); JOINTS_MAX + 1] };
    let mut clear = |q: &[f64; JOINTS_MAX]| clearance(model, &mut frames, q).distance_m - model.d_min_m;
    loop {
        let q: [f64; JOINTS_MAX] = std::array::from_fn(|j| {
            let (l, room) = (&model.limits[j], 0.2 * (model.limits[j].q_max - model.limits[j].q_min));
            if j < JOINTS { rng.random_range(l.q_min + room..l.q_max - room) } else { 0.0 }
        });
        let j = rng.random_range(3..JOINTS);
        let at = |s: f64| std::array::from_fn(|i| if i == j { q[i] + s } else { q[i] });
        if clear(&q) < 0.005 || clear(&at(0.1)) > -0.02 {
            continue;
        }
        let (mut low, mut high) = (0.0, 0.1);
        for _ in 0..60 {
            let middle = (low + high) / 2.0;
            if clear(&at(middle)) >= 0.0 { low = middle } else { high = middle }
        }
        let slope = (clear(&at(low)) - clear(&at(low + 1e-6))) / 1e-6;
        if slope > 0.1 && low > 0.02 {
            return (q, j, low, slope);
        }
    }
}

#[test]
fn f045_self_collision_is_denied_at_command_and_at_rest() {
    let model = model();
    let config = Config::new(&model).unwrap();
    let (q, j, to_contact, slope) = towards_collision(&model);
    let l = &model.limits[j];
    let (v, jerk) = (0.1, 0.0);
    // From (v, 0) the next command is v T further, and the stop takes the rest.
    let reach = Joint { q: 0.0, v, a: 0.0 }.play(&stop_from(Joint { q: 0.0, v, a: 0.0 }, l.a_max, l.j_max), 1e3).q;
    let stop_reach = v * T + reach;
    let case = |margin_m: f64, at: f64| {
        let mut seed = resting(0, q);
        let x = Joint { q: q[j] + to_contact - at - margin_m / slope, v, a: 0.0 };
        set_stopping(&mut seed, j, x, l);
        let mut state = State::at_rest(q);
        state.reseed(&seed.motion);
        let mut next = resting(1, q);
        set_stopping(&mut next, j, x.after(jerk, T), l);
        decide(&config, &mut state, next).verdict
    };
    // The slack is 1 nm. Half of it is allowed, and twice of it is not.
    let (granted, denied) = (-5e-10, -2e-9);
    assert_eq!(case(granted, stop_reach), Verdict::Accept);
    assert!(matches!(case(denied, stop_reach), Verdict::Deny(Denial::ClearanceAtRest { .. })));
    assert!(matches!(case(granted, v * T), Verdict::Deny(Denial::ClearanceAtRest { .. })));
    assert!(matches!(case(denied, v * T), Verdict::Deny(Denial::ClearanceAtCommand { .. })));
}

/// `TELEOPD_GATE_ATTACKS` sets more attacks of each kind.
#[test]
fn f041_adversarial_steps_break_no_limit() {
    let attacks = std::env::var("TELEOPD_GATE_ATTACKS").map_or(1, |attacks| attacks.parse().expect("a count"));
    // There are 17 joints each: 1.02e6 joint steps without pairs, 1.7e5 with them.
    for (model, ticks, seed) in [(without_pairs(), 60_000, 1), (model(), 10_000, 2)] {
        (0..attacks).for_each(|attack| attack_gate(&model, ticks, seed + 2 * attack));
    }
}

fn attack_gate(model: &Model, ticks: u64, seed: u64) {
    let mut adversary = Adversary::new(model, seed);
    for _ in 0..ticks {
        adversary.step();
    }
    let report = &adversary.report;
    let violations = report.violations.len();
    assert_eq!(violations, 0, "seed {seed}: first: {:?}", report.violations.first());
    assert!(report.damaged > ticks / 10, "{report:?}");
    assert_eq!(report.honest_denied, 0, "what the judge finds sound is never denied: {report:?}");
    if model.pairs.is_empty() {
        assert!(report.accepted > ticks / 2, "{report:?}");
    } else {
        assert!(report.accepted > ticks / 20 && report.clearance > 0, "{report:?}");
    }
    println!("{report:?}");
}

/// With obstacles, with a driver whose state is another posture each 200 ticks, and while the robot recovers.
#[test]
fn verdicts_do_not_depend_on_known_distances() {
    let mut model = model();
    model.obstacles = judge::surroundings(0.2);
    let mut adversary = Adversary::new(&model, 3);
    let mut accepted = [0; 2];
    for n in 0..20_000 {
        if n % 200 == 0 {
            adversary.reseed(n % 400 == 0);
        }
        let before = adversary.report.accepted;
        adversary.step();
        accepted[n / 200 % 2] += adversary.report.accepted - before;
    }
    // A state within a limit or an obstacle is nothing that the gate let through, so only the comparison counts.
    let differs = adversary.report.violations.iter().find(|violation| violation.contains("without bounds"));
    assert_eq!(differs, None);
    assert!(accepted.iter().all(|&count| count > 100) && adversary.report.clearance > 100, "{accepted:?}");
}

#[test]
fn random_bits_are_denied_and_robot_rests_at_home() {
    let model = model();
    let config = Config::new(&model).unwrap();
    let mut rng = Pcg64::seed_from_u64(21);
    let mut state = State::at_rest(model.home);
    for n in 0..50_000 {
        let mut bits = || match rng.random_range(0..8) {
            0 => f64::NAN,
            1 => f64::INFINITY,
            2 => 63.9 - rng.random_range(0.0..128.0),
            3 => 1_048_576.0 * (1.0 - rng.random_range(0.0..2.0)),
            4 => rng.random_range(0.0..16.0),
            5 => 0.0,
            _ => f64::from_bits(rng.next_u64()),
        };
        let mut list = || -> [f64; JOINTS_MAX] { std::array::from_fn(|_| bits()) };
        let [q, v, a] = [list(), list(), list()];
        let plan = StopPlan {
            jerk: std::array::from_fn(|_| std::array::from_fn(|_| bits())),
            duration_s: std::array::from_fn(|_| std::array::from_fn(|_| bits())),
        };
        let motion = JointMotion { q, v, a, plan };
        if n % 3 == 0 {
            state.reseed(&motion);
        }
        let k = if n % 2 == 0 { n } else { bits().to_bits() };
        let permit = if n % 5 == 0 { Permit::Stop } else { Permit::Follow { speed_scale: bits() } };
        let sent = decide(&config, &mut state, Proposed { k, permit, motion });
        assert!(!sent.accepted());
        let at_home = (0..JOINTS).all(|j| (sent.motion.q[j] - model.home[j]).abs() < 1e-12 && sent.motion.v[j] == 0.0);
        assert!(at_home && sent.motion.plan == NO_PLAN, "random bits come to rest nowhere, so no seed was taken");
    }
}

#[test]
fn invalid_limits_or_clearance_are_refused() {
    type Damage = fn(&mut Model);
    let cases: [Damage; 9] = [
        |m| m.limits[2].q_max = f64::NAN,
        |m| m.limits[2].q_max = m.limits[2].q_min,
        |m| m.limits[2].v_max = 0.0,
        |m| m.limits[2].v_max = 65.0,
        |m| m.limits[2].a_max = f64::INFINITY,
        |m| m.limits[2].a_max = -1.0,
        |m| m.limits[2].j_max = 1e9,
        |m| m.limits[2].j_max = f64::NAN,
        |m| m.limits[2].q_min = -100.0,
    ];
    for damage in cases {
        let mut model = model();
        damage(&mut model);
        let error = Config::new(&model).expect_err("refused");
        assert!(matches!(error, ConfigError::Limit { .. }) && error.to_string().contains(&model.joint_names[2]));
    }
    for d_min_m in [0.0, -0.01, f64::NAN, f64::INFINITY] {
        let mut model = model();
        model.d_min_m = d_min_m;
        assert!(matches!(Config::new(&model), Err(ConfigError::Clearance(_))));
    }
}
