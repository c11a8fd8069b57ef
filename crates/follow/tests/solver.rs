//! The sweep keeps bounds and lowers costs.

use crate::support::{arm, bounds, problem, random_q, random_rotation};
use follow::arm::{ArmVector, Limbs};
use follow::gap::Gap;
use follow::solver::{Problem, State, Sweep, Weights};
use follow::{LIMB_JOINTS, NODES};
use nalgebra::Vector3;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

/// Tolerance for rounding.
const ROUNDING: f64 = 1e-9;

fn iterate(sweep: &mut Sweep, weights: &Weights, problem: &Problem) -> [f64; 2] {
    let arm = arm();
    sweep.begin(&arm, weights, problem);
    let before = sweep.cost();
    for i in (0..NODES).rev() {
        sweep.backward(&arm, weights, problem, i);
    }
    sweep.finish(&arm, weights, problem);
    [before, sweep.cost()]
}

/// Any person, from any state. A quarter of the states are faster than allowed.
fn random_problem(rng: &mut Pcg64) -> Problem {
    let mut problem = problem(random_q(rng), Limbs::identity());
    let fastest = if rng.random_bool(0.25) { 2.0 } else { 1.0 };
    let scale = rng.random_range(0.05..1.0);
    problem.bounds.v_max = ArmVector::from_fn(|_, _| scale * rng.random_range(0.3..3.0));
    problem.bounds.a_max = ArmVector::from_fn(|_, _| rng.random_range(2.0..30.0));
    problem.start.v = problem.bounds.v_max.map(|v| v * fastest * rng.random_range(-1.0..1.0));
    problem.interval_s[0] = messages::TICK_S * f64::from(rng.random_range(1..=30));
    let steady = rng.random_bool(0.5);
    for i in 0..NODES {
        if i == 0 || !steady {
            problem.person[i] = Limbs { upper: random_rotation(rng), fore: random_rotation(rng) };
        } else {
            problem.person[i] = problem.person[0];
        }
    }
    problem.prior = random_q(rng);
    problem.pull = rng.random_range(0.0..0.5);
    let touching = rng.random_bool(0.5);
    problem.places = std::array::from_fn(|_| {
        touching.then(|| (Vector3::from_fn(|_, _| rng.random_range(-0.8..0.8)), rng.random_range(0.0..1.0)))
    });
    for watched in 0..5 {
        for _ in 0..rng.random_range(0..12) {
            let slope = ArmVector::from_fn(|_, _| rng.random_range(-0.5..0.5));
            problem.gaps.insert(watched, Gap::new(rng.random_range(-0.05..0.05), slope, &problem.start.q));
        }
    }
    problem
}

/// Checks that accelerations and speeds are within bounds. A joint that was too fast brakes as hard as it may.
fn assert_within(problem: &Problem, sweep: &Sweep, context: &str) {
    let bounds = &problem.bounds;
    let mut state = problem.start;
    for (i, input) in sweep.input.iter().enumerate() {
        let d = problem.interval_s[i];
        let next = state.after(input, d);
        assert_eq!(&next, &sweep.nodes()[i], "{context}, node {i}");
        for j in 0..LIMB_JOINTS {
            let (u, a_max, v_max) = (input[j], bounds.a_max[j], bounds.v_max[j]);
            assert!(u.abs() <= a_max, "{context}, node {i}: joint {j} accelerates by {u} of {a_max}");
            let allowed = v_max.max(state.v[j].abs() - a_max * d) + ROUNDING;
            assert!(next.v[j].abs() <= allowed, "{context}, node {i}: joint {j} at {} of {v_max}", next.v[j]);
        }
        state = next;
    }
}

#[test]
fn every_node_keeps_acceleration_and_speed_bounds() {
    let mut rng = Pcg64::seed_from_u64(11);
    let mut at_bounds = 0;
    for case in 0..400 {
        let problem = random_problem(&mut rng);
        let mut sweep = Sweep::default();
        for input in &mut sweep.input {
            *input = ArmVector::from_fn(|_, _| rng.random_range(-100.0..100.0));
        }
        for iteration in 0..5 {
            iterate(&mut sweep, &Weights::default(), &problem);
            assert_within(&problem, &sweep, &format!("case {case}, iteration {iteration}"));
        }
        let hit = |node: &State| (0..LIMB_JOINTS).any(|j| node.v[j].abs() >= problem.bounds.v_max[j] - ROUNDING);
        at_bounds += u32::from(sweep.nodes().iter().any(hit));
    }
    assert!(at_bounds > 200, "bounds hardly matter: {at_bounds} cases");
}

#[test]
fn iteration_never_raises_cost() {
    let mut rng = Pcg64::seed_from_u64(12);
    let mut gained = 0;
    for case in 0..400 {
        let problem = random_problem(&mut rng);
        let mut sweep = Sweep::default();
        let (mut first, mut last) = (0.0, f64::INFINITY);
        for iteration in 0..12 {
            let [before, after] = iterate(&mut sweep, &Weights::default(), &problem);
            assert!(after <= before, "case {case}, iteration {iteration}: {before} rose to {after}");
            // An iteration starts where the previous one ended, so clamping changed nothing.
            assert!((before - last).abs() <= 1e-9 * before || iteration == 0, "case {case}: {last} became {before}");
            (first, last) = (if iteration == 0 { before } else { first }, after);
        }
        gained += u32::from(last < 0.99 * first);
    }
    println!("{gained} of 400 problems gained at least 1 % in twelve iterations");
    assert!(gained > 380, "only {gained} of 400 problems gained at least 1 %");
}

#[test]
fn solution_after_60_iterations_is_within_1_percent_of_minimum() {
    // No single change of an input within its bounds gains more than a hundredth.
    let mut rng = Pcg64::seed_from_u64(13);
    let (arm, weights) = (arm(), Weights::default());
    let mut worst = 0.0_f64;
    for case in 0..20 {
        let start = random_q(&mut rng);
        let goal = start + ArmVector::from_fn(|_, _| rng.random_range(-0.3..0.3));
        let problem = Problem { prior: goal, ..problem(start, arm.limbs(&goal)) };
        let mut sweep = Sweep::default();
        for _ in 0..60 {
            iterate(&mut sweep, &weights, &problem);
        }
        let best = sweep.cost();
        let mut cheapest = best;
        for _ in 0..200 {
            let mut other = sweep.clone();
            let (i, j) = (rng.random_range(0..NODES), rng.random_range(0..LIMB_JOINTS));
            other.input[i][j] += rng.random_range(-0.5..0.5);
            other.begin(&arm, &weights, &problem);
            cheapest = other.cost().min(cheapest);
        }
        worst = worst.max(1.0 - cheapest / best);
        assert!(cheapest >= 0.99 * best, "case {case}: {cheapest} instead of {best}");
    }
    println!("a single change saves {worst:.1e} at most");
}

#[test]
fn joint_with_target_beyond_range_ends_at_range_end() {
    // A person whom the robot can only reach beyond its range, at each end of every joint.
    let (arm, bounds) = (arm(), bounds());
    for j in 0..LIMB_JOINTS {
        for (end, sign) in [(bounds.q_max[j], 1.0), (bounds.q_min[j], -1.0)] {
            let mut beyond = ArmVector::from(crate::support::FREE);
            beyond[j] = end + sign * 0.5;
            let mut start = beyond;
            start[j] = end - sign * 0.3;
            let problem = problem(start, arm.limbs(&beyond));
            let mut sweep = Sweep::default();
            for _ in 0..30 {
                iterate(&mut sweep, &Weights::default(), &problem);
            }
            let last = sweep.nodes()[NODES - 1].q[j];
            assert!(sign * (last - end) < 0.01, "joint {j} ends {} rad beyond its range", sign * (last - end));
            assert!(sign * (last - end) > -0.05, "joint {j} stays {} rad inside", sign * (end - last));
        }
    }
}
