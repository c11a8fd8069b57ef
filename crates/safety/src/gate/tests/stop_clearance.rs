//! Tests the gate's kinematics and the pairs that it skips, against the other implementation at every sample.

use super::*;
use crate::clearance::tests::{all_distances, shipped, solids};
use crate::gate::fixed::{Phase, TIME_UNITS};
use crate::gate::stored::{Phases, Stored};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use robot::Frames;

/// Requirements for every motion of these tests.
const REQUIRED: Requirement = Requirement { least_m: 0.01, interface: true };
/// States so close to the least clearance are skipped, because rounding decides them.
const UNDECIDED_M: f64 = 1e-9;

fn stop_clearance(model: &Model, interface: &Interface) -> StopClearance {
    StopClearance::new(model, interface, &model.limits).expect("the robot of the repository is allowed")
}

fn random_posture(model: &Model, rng: &mut Pcg64) -> [f64; JOINTS_MAX] {
    model.limits.map(|limits| rng.random_range(limits.q_min..=limits.q_max))
}

/// The least distance at `q`, by the other implementation.
fn least_m(model: &Model, q: &[f64; JOINTS_MAX]) -> f64 {
    let mut frames = Frames::default();
    model.forward(q, &mut frames);
    all_distances(model, &frames)[0].0
}

/// Returns either no obstacles, or obstacles that leave the robot some postures.
fn surroundings(model: &mut Model, rng: &mut Pcg64, none: bool) {
    loop {
        model.obstacles = if none { vec![] } else { solids(rng) };
        let clear = |q: [f64; JOINTS_MAX]| least_m(model, &q) >= REQUIRED.least_m;
        if (0..40).filter(|_| clear(random_posture(model, rng))).count() > 5 {
            return;
        }
    }
}

#[test]
fn own_kinematics_match_robot_model() {
    let model = shipped();
    let body = Body::new(&model);
    let (mut rng, mut frames, mut worst) = (Pcg64::seed_from_u64(31), Frames::default(), 0.0_f64);
    for n in 0..10_000 {
        // Some postures are far outside the limits, as a robot that needs recovery may be.
        let size = if n % 10 == 0 { 3.0 } else { 1.0 };
        let q = random_posture(&model, &mut rng).map(|q| size * q);
        let posed = Posed::new(&body, &q);
        model.forward(&q, &mut frames);
        for (axis, capsule) in posed.axes.iter().zip(&model.capsules) {
            let pose = &frames.base_from_body[capsule.body];
            for (own, other) in axis.ends.iter().zip([&capsule.a, &capsule.b]) {
                worst = worst.max((own - pose.transform_point(other)).amax());
            }
        }
    }
    assert!(worst < 1e-12, "{worst}");
}

#[test]
fn pair_distance_changes_within_lever_bound() {
    let mut model = shipped();
    let (mut rng, mut nearly, mut body) = (Pcg64::seed_from_u64(32), 0, Body::new(&model));
    for n in 0..2000 {
        if n % 100 == 0 {
            model.obstacles = if n % 200 == 0 { vec![] } else { solids(&mut rng) };
            body = Body::new(&model);
        }
        let from = random_posture(&model, &mut rng);
        // One joint moves, or a few, or all of them.
        let share = [0.06, 0.3, 1.0][n % 3];
        let size = [0.01, 0.1, 1.0][n / 3 % 3];
        let to = std::array::from_fn(|j| {
            let limits = &model.limits[j];
            let goal = rng.random_range(limits.q_min..=limits.q_max);
            if rng.random_bool(share) { from[j] + size * (goal - from[j]) } else { from[j] }
        });
        let mut moved = NO_ROWS;
        body.move_by(&std::array::from_fn(|j| (to[j] - from[j]).abs()), &mut moved);
        let [before, after] = [from, to].map(|q| Posed::new(&body, &q));
        for pair in 0..body.pair_count() {
            let [d0, d1] = [&before, &after].map(|posed| body.distance(pair, &posed.axes));
            let change = body.change(pair, &moved);
            assert!((d1 - d0).abs() <= change + 1e-12, "{n} {:?}: {d0} {d1} {change}", body.named(pair));
            nearly += u32::from((d1 - d0).abs() > 0.9 * change && change > 1e-3);
        }
    }
    assert!(nearly > 1000, "the bound is met by {nearly}");
}

/// A random state, with a stop that need not end at rest: its phases go forth and back.
fn random_motion(model: &Model, rng: &mut Pcg64, q: &[f64; JOINTS_MAX]) -> ([Point; JOINTS_MAX], [Phases; JOINTS_MAX]) {
    let share = [0.15, 0.5, 1.0][rng.random_range(0..3)];
    let speed = [0.0, 0.3, 1.0, 3.0][rng.random_range(0..4)];
    let moves: [bool; JOINTS_MAX] = std::array::from_fn(|_| rng.random_bool(share));
    let next = std::array::from_fn(|j| {
        let v = if moves[j] { speed * model.limits[j].v_max * rng.random_range(-1.0..=1.0) } else { 0.0 };
        Point::quantised(q[j], v, 0.0).unwrap_or_default()
    });
    let phases = std::array::from_fn(|j| {
        let mut phases = Phases::default();
        for phase in phases.iter_mut().filter(|_| moves[j]) {
            let duration = [0.0, rng.random_range(0.0..0.15)][rng.random_range(0..2)];
            let jerk = model.limits[j].j_max * 0.3 * rng.random_range(-1.0..=1.0);
            *phase = Phase { jerk: (jerk * UNITS) as i64, duration: (duration * TIME_UNITS) as i64 };
        }
        phases
    });
    (next, phases)
}

/// Returns phases from the speed of `start` to rest, first with `jerk` and then against it.
fn braking(start: Point, jerk: i64) -> Phases {
    let duration = ((start.v.abs() as f64 / jerk as f64).sqrt() * TIME_UNITS) as i64;
    let jerk = -jerk * start.v.signum();
    [Phase { jerk, duration }, Phase { jerk: -jerk, duration }, Phase::default()]
}

fn stop_of(start: Point, phases: &Phases) -> Stop {
    let mut stop = Stop::new(start, phases);
    for (i, phase) in phases.iter().enumerate() {
        let (end, extremes) = phase.play(stop.end());
        stop.record(i, end, &extremes);
    }
    stop
}

/// Positions `ticks` after the beginning of `stored`, as they would be sent.
fn played(stored: &Stored, ticks: u64) -> [f64; JOINTS_MAX] {
    std::array::from_fn(|j| stored.joint(j, ticks).0.q as f64 / UNITS)
}

/// The ticks at which the gate must check, computed without its arithmetic.
fn looked_at(phases: &[Phases; JOINTS_MAX]) -> Vec<u64> {
    let long = |phases: &Phases| phases.iter().map(|phase| phase.duration as f64 / TIME_UNITS).sum::<f64>();
    let ticks = (phases.iter().map(long).fold(0.0, f64::max) * 1500.0 - 1e-9).ceil().max(0.0);
    (1..=10).map(|i| (ticks * f64::from(i) / 10.0 - 1e-9).ceil().max(0.0) as u64).collect()
}

/// The expected verdict on a motion, by all distances at all samples. None if rounding decides.
fn expected(model: &Model, next: &[Point; JOINTS_MAX], phases: &[Phases; JOINTS_MAX]) -> Option<&'static str> {
    let stored = Stored::new(*next, *phases);
    let ticks = looked_at(phases);
    let spare = |ticks: u64| least_m(model, &played(&stored, ticks)) - REQUIRED.least_m;
    let (at_command, at_rest) = (spare(0), spare(ticks[9]));
    let on_the_way = ticks[..9].iter().map(|&ticks| spare(ticks)).fold(f64::INFINITY, f64::min);
    let all = [(at_command, "command"), (at_rest, "rest"), (on_the_way, "way")];
    let decided = all.iter().all(|(spare, _)| spare.abs() > UNDECIDED_M);
    decided.then(|| all.iter().find(|(spare, _)| *spare < 0.0).map_or("clear", |(_, place)| place))
}

/// A posture that is clear, mostly by little.
fn clear_posture(model: &Model, rng: &mut Pcg64) -> [f64; JOINTS_MAX] {
    loop {
        let (from, to) = (random_posture(model, rng), random_posture(model, rng));
        let at = |s: f64| -> [f64; JOINTS_MAX] { std::array::from_fn(|j| from[j] + s * (to[j] - from[j])) };
        if least_m(model, &at(0.0)) < REQUIRED.least_m {
            continue;
        }
        // The posture goes as far towards the other one as a few halvings find it clear, and back by a little.
        let (mut low, mut high) = (0.0, 1.0);
        for _ in 0..rng.random_range(1..12) {
            let middle = (low + high) / 2.0;
            if least_m(model, &at(middle)) >= REQUIRED.least_m { low = middle } else { high = middle }
        }
        return at(low);
    }
}

#[test]
fn stop_verdict_matches_all_distances_at_all_samples() {
    let mut model = shipped();
    let mut rng = Pcg64::seed_from_u64(33);
    let mut own = stop_clearance(&model, &Interface::default());
    let mut counts = std::collections::BTreeMap::<&str, u32>::new();
    let mut memory = Memory::new();
    for n in 0..8000 {
        if n % 50 == 0 {
            surroundings(&mut model, &mut rng, n % 100 == 0);
            own = stop_clearance(&model, &Interface::default());
            memory = Memory::new();
        }
        let q = if n % 7 == 0 { random_posture(&model, &mut rng) } else { clear_posture(&model, &mut rng) };
        let (next, phases) = random_motion(&model, &mut rng, &q);
        let Some(expected) = expected(&model, &next, &phases) else { continue };
        let stops = std::array::from_fn(|j| stop_of(next[j], &phases[j]));
        let got = own.judge(&next, &stops, REQUIRED, &mut memory);
        let verdict = match got {
            Ok(clearance_m) => {
                assert!((clearance_m - least_m(&model, &played(&Stored::new(next, phases), 0))).abs() < 1e-9, "{n}");
                "clear"
            }
            Err(Denial::ClearanceAtCommand { .. }) => "command",
            Err(Denial::ClearanceAtRest { .. }) => "rest",
            Err(Denial::ClearanceOnTheWay { .. }) => "way",
            Err(other) => panic!("{other:?}"),
        };
        assert_eq!(verdict, expected, "{n}: {got:?}");
        *counts.entry(verdict).or_default() += 1;
    }
    assert!(counts.len() == 4 && counts.values().all(|&count| count > 100), "{counts:?}");
}

/// A pair for which no sample is computed is clear at every instant, between samples too.
#[test]
fn pair_without_samples_is_clear_at_every_instant() {
    let mut model = shipped();
    let mut rng = Pcg64::seed_from_u64(34);
    let (mut own, mut proved, mut left) = (stop_clearance(&model, &Interface::default()), 0, 0);
    for n in 0..1500 {
        if n % 50 == 0 {
            surroundings(&mut model, &mut rng, n % 100 == 0);
            own = stop_clearance(&model, &Interface::default());
        }
        let q = clear_posture(&model, &mut rng);
        let (next, phases) = random_motion(&model, &mut rng, &q);
        let stops: [Stop; JOINTS_MAX] = std::array::from_fn(|j| stop_of(next[j], &phases[j]));
        let mut memory = Memory::new();
        let Ok((_, count)) = own.at_command(&next, &stops, REQUIRED, &mut memory) else { continue };
        let open: std::collections::BTreeSet<_> =
            memory.open[..count].iter().map(|open| usize::from(open.pair)).collect();
        (proved, left) = (proved + own.body.pair_count() - count, left + count);
        let longest = stops.iter().map(Stop::duration).max().unwrap_or(0);
        for _ in 0..10 {
            let at = (longest as f64 * rng.random::<f64>()) as i64;
            let posed = Posed::new(&own.body, &positions(&std::array::from_fn(|j| stops[j].at(at))));
            for pair in (0..own.body.pair_count()).filter(|pair| !open.contains(pair)) {
                assert!(own.body.distance(pair, &posed.axes) >= REQUIRED.least_m, "{n}: {:?}", own.body.named(pair));
            }
        }
    }
    assert!(proved > 100_000 && left > 10_000, "{proved}, {left}");
}

/// Any deviation of the interface from an accepted motion keeps the clearance at a sample.
#[test]
fn accepted_motion_with_lag_and_deviation_keeps_clearance() {
    let mut model = shipped();
    let mut rng = Pcg64::seed_from_u64(35);
    let controller = std::array::from_fn(|j| if j < 3 { [0, 1, 1][j] } else { 2 + (j - 3) / 7 });
    let interface = Interface { off: [1e-4; JOINTS_MAX], skew_s: 0.01, controller };
    let (mut accepted, mut denied, mut closer) = (0, 0, 0);
    let mut own = [interface, Interface::default()].map(|interface| stop_clearance(&model, &interface));
    for n in 0..3000 {
        if n % 50 == 0 {
            surroundings(&mut model, &mut rng, n % 100 == 0);
            own = [interface, Interface::default()].map(|interface| stop_clearance(&model, &interface));
        }
        let q = clear_posture(&model, &mut rng);
        let (next, _) = random_motion(&model, &mut rng, &q);
        let phases: [Phases; JOINTS_MAX] =
            std::array::from_fn(|j| braking(next[j], (0.5 * model.limits[j].j_max * UNITS) as i64));
        let stops: [Stop; JOINTS_MAX] = std::array::from_fn(|j| stop_of(next[j], &phases[j]));
        let [with, without] = own.each_ref().map(|own| own.judge(&next, &stops, REQUIRED, &mut Memory::new()).is_ok());
        assert!(without || !with);
        denied += u32::from(without && !with);
        if !without {
            continue;
        }
        for time in [0].into_iter().chain(sample_times(&stops)) {
            // One controller lags. A pair that it moves alone is where the command was, and no sample was taken there.
            let (late, lag_s) = (rng.random_range(0..4), [0.01, rng.random_range(0.0..0.01)][rng.random_range(0..2)]);
            let q = std::array::from_fn(|j| {
                let at = if controller[j] == late { time - (lag_s * TIME_UNITS) as i64 } else { time };
                // Before the command, the joint had the speed that it has at the command.
                let from = stops[j].at(at.max(0)).q as f64 / UNITS;
                let before = next[j].v as f64 / UNITS * (at.min(0) as f64 / TIME_UNITS);
                from + before + rng.random_range(-1e-4..=1e-4)
            });
            let body = &own[0].body;
            let posed = Posed::new(body, &q);
            let alone = |&pair: &usize| body.between(pair).all(|(j, _)| controller[j] == late);
            let mut pairs = (0..body.pair_count()).filter(|pair| !alone(pair));
            let kept = pairs.all(|pair| body.distance(pair, &posed.axes) >= REQUIRED.least_m);
            assert!(kept || !with, "{n}");
            closer += u32::from(!kept);
        }
        accepted += u32::from(with);
    }
    assert!(accepted > 500 && denied > 100 && closer > 20, "{accepted} {denied} {closer}");
}

#[test]
fn interface_out_of_bounds_is_refused() {
    let model = shipped();
    let sound = Interface { off: [1e-5; JOINTS_MAX], skew_s: 0.01, controller: [0; JOINTS_MAX] };
    assert!(StopClearance::new(&model, &sound, &model.limits).is_ok());
    type Damage = fn(&mut Interface);
    let cases: [Damage; 6] = [
        |i| i.skew_s = f64::NAN,
        |i| i.skew_s = -1e-3,
        |i| i.skew_s = 0.051,
        |i| i.off[5] = f64::INFINITY,
        |i| i.off[5] = 1.1e-3,
        |i| i.controller[5] = JOINTS_MAX,
    ];
    for damage in cases {
        let mut interface = sound;
        damage(&mut interface);
        let refused = StopClearance::new(&model, &interface, &model.limits);
        assert!(matches!(refused, Err(ConfigError::Interface { .. })), "{interface:?}");
    }
}
