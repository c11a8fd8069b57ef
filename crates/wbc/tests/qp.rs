//! Tests the quadratic program against another solver, and against the conditions of optimality.

use clarabel::algebra::CscMatrix;
use clarabel::solver::{DefaultSettings, DefaultSolver, IPSolver, NonnegativeConeT, SolverStatus};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use wbc::qp::{ActiveSet, Problem, ROWS_MAX, STEPS_MAX, Status, UNKNOWNS, solve};

/// Unknowns of a problem: the joints of TIAGo++.
const COUNT: usize = 17;

/// A problem shaped like that of a control tick: two blocks of limbs over a diagonal, bounds around zero, and
/// rows that mostly hold at zero.
fn random(rng: &mut Pcg64) -> Problem {
    let mut problem = Problem { count: COUNT, ..Problem::default() };
    for i in 0..COUNT {
        problem.hessian[i][i] = 10.0_f64.powf(rng.random_range(-2.0..1.0));
    }
    for arm in [3..8, 10..15] {
        for _ in 0..6 {
            let task: [f64; UNKNOWNS] =
                std::array::from_fn(|i| if arm.contains(&i) { rng.random_range(-1.0..1.0) } else { 0.0 });
            for i in 0..COUNT {
                for k in 0..COUNT {
                    problem.hessian[i][k] += task[i] * task[k];
                }
            }
        }
    }
    for i in 0..COUNT {
        problem.lower[i] = -rng.random_range(0.0..2.0);
        problem.upper[i] = rng.random_range(0.0..2.0);
        problem.reference[i] = rng.random_range(-3.0..3.0);
    }
    problem.row_count = rng.random_range(0..=ROWS_MAX);
    let zero_is_feasible = rng.random_range(0.0..1.0) < 0.9;
    for k in 0..problem.row_count {
        problem.rows[k] = std::array::from_fn(|i| {
            // A pair on one arm does not depend on the other arm.
            let seen = i < COUNT && (!(3..10).contains(&i) || k % 3 != 0);
            if seen { rng.random_range(-1.0..1.0) } else { 0.0 }
        });
        problem.least[k] = -rng.random_range(0.0..0.3_f64).powi(2);
        if !zero_is_feasible && k % 5 == 0 {
            problem.least[k] = rng.random_range(0.0..2.0);
        }
    }
    problem
}

/// The same program in clarabel's form: A z + s = b, s >= 0.
fn oracle(problem: &Problem) -> (SolverStatus, Vec<f64>) {
    let own = |row: &[f64; UNKNOWNS]| -> [f64; COUNT] { std::array::from_fn(|k| row[k]) };
    let rows: Vec<[f64; COUNT]> = problem.hessian[..COUNT].iter().map(own).collect();
    let hessian = CscMatrix::from(rows.iter()).to_triu();
    let linear: Vec<f64> =
        rows.iter().map(|row| -(0..COUNT).map(|k| row[k] * problem.reference[k]).sum::<f64>()).collect();
    let unit = |i: usize, sign: f64| -> [f64; COUNT] { std::array::from_fn(|k| if i == k { sign } else { 0.0 }) };
    let mut a: Vec<[f64; COUNT]> = Vec::new();
    let mut b = Vec::new();
    for i in 0..COUNT {
        a.extend([unit(i, 1.0), unit(i, -1.0)]);
        b.extend([problem.upper[i], -problem.lower[i]]);
    }
    for k in 0..problem.row_count {
        a.push(std::array::from_fn(|i| -problem.rows[k][i]));
        b.push(-problem.least[k]);
    }
    let cones = [NonnegativeConeT(b.len())];
    let settings = DefaultSettings {
        verbose: false,
        tol_gap_abs: 1e-14,
        tol_gap_rel: 1e-14,
        tol_feas: 1e-14,
        max_iter: 200,
        ..DefaultSettings::default()
    };
    let rows = CscMatrix::from(a.iter());
    let mut solver = DefaultSolver::new(&hessian, &linear, &rows, &b, &cones, settings).expect("a valid program");
    solver.solve();
    (solver.solution.status, solver.solution.x.clone())
}

fn cost(problem: &Problem, z: &[f64]) -> f64 {
    let off: Vec<f64> = (0..COUNT).map(|i| z[i] - problem.reference[i]).collect();
    (0..COUNT).map(|i| (0..COUNT).map(|k| 0.5 * off[i] * problem.hessian[i][k] * off[k]).sum::<f64>()).sum()
}

fn violation(problem: &Problem, z: &[f64]) -> f64 {
    let mut worst = 0.0_f64;
    for (z, (lower, upper)) in z.iter().zip(problem.lower.iter().zip(&problem.upper)).take(COUNT) {
        worst = worst.max(lower - z).max(z - upper);
    }
    for k in 0..problem.row_count {
        let value: f64 = (0..COUNT).map(|i| problem.rows[k][i] * z[i]).sum();
        worst = worst.max(problem.least[k] - value);
    }
    worst
}

#[test]
fn f047_random_problems_match_another_solver() {
    let mut rng = Pcg64::seed_from_u64(4);
    let (mut feasible, mut infeasible, mut bound, mut gave_up, mut most) = (0, 0, 0, 0, 0);
    for n in 0..10_000 {
        let problem = random(&mut rng);
        let own = solve(&problem, &mut ActiveSet::default());
        let (status, z) = oracle(&problem);
        most = most.max(own.steps);
        if own.status == Status::Infeasible {
            assert_eq!(status, SolverStatus::PrimalInfeasible, "problem {n}");
            infeasible += 1;
            continue;
        }
        assert_eq!(own.status, Status::Optimal, "problem {n}");
        assert_ne!(status, SolverStatus::PrimalInfeasible, "problem {n}");
        feasible += 1;
        bound += usize::from(own.steps > 0);
        assert!(violation(&problem, &own.z) < 1e-12, "problem {n}: {:e}", violation(&problem, &own.z));
        // An interior point may stop outside by its tolerance. Then ours may cost more by as much, but no more.
        let (ours, theirs) = (cost(&problem, &own.z), cost(&problem, &z));
        let off = (0..COUNT).fold(0.0_f64, |off, i| off.max((own.z[i] - z[i]).abs()));
        if status == SolverStatus::Solved {
            assert!((ours - theirs).abs() <= 1e-9 * (1.0 + theirs), "problem {n}: cost {ours} against {theirs}");
            assert!(off <= 1e-6, "problem {n}: solutions {off:e} apart");
        } else {
            // The other solver gave up before it converged. Then ours is feasible and costs no more.
            gave_up += 1;
            assert!(ours <= theirs + 1e-9, "problem {n}: cost {ours} against {theirs} ({status:?})");
        }
    }
    assert!(feasible > 8_000 && infeasible > 200 && bound > 9_000, "{feasible} {infeasible} {bound}");
    assert!(gave_up < 10, "{gave_up} without an oracle");
    assert!(most < STEPS_MAX, "{most} steps");
    println!("{feasible} feasible, {infeasible} infeasible, at most {most} steps");
}
