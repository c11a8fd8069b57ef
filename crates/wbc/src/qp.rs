//! A small strictly convex quadratic program, solved exactly by a dual active set.
//!
//! ```text
//! minimise  1/2 (z - r)^T H (z - r)   over z in R^n
//! such that lower <= z <= upper  and  g_k . z >= c_k for up to 24 rows k
//! ```
//!
//! Method: Goldfarb and Idnani, "A numerically stable dual method for solving strictly convex quadratic
//! programs", Mathematical Programming 27 (1983). With H = L L^T it begins at the unconstrained optimum r
//! with the basis J = L^-T, and adds one violated constraint after another. Each step keeps the multipliers
//! of the active ones at zero or above. So every iterate is the optimum of the constraints seen so far.
//!
//! The first columns of J span the active normals (J1, with J1^T N = R upper triangular). The other columns,
//! J2, span their complement. For a violated constraint with normal n, let d = J^T n. The step in z is J2 d2,
//! and the step in the multipliers is R^-1 d1. Rotations add and drop a constraint in O(n^2).
//!
//! Warm start: constraints that were active at the last solution are considered first. So if little has
//! changed, the final set is found without detours. The work is bounded, and nothing allocates or panics. A
//! failure is reported as a [`Status`].

#![allow(clippy::indexing_slicing, reason = "all indices run over arrays of fixed size")]

use messages::JOINTS_MAX;

/// Largest number of unknowns.
pub const UNKNOWNS: usize = JOINTS_MAX;
/// Largest number of rows.
pub const ROWS_MAX: usize = 24;
/// Number of lower bounds, upper bounds and rows, in this order.
const CONSTRAINTS: usize = 2 * UNKNOWNS + ROWS_MAX;
/// Steps after which the solver gives up. Each constraint enters or leaves in one step, so all of them could do so more
/// than once. Random problems of full size need 40 at most (`tests/qp.rs` asserts it stays below the limit).
pub const STEPS_MAX: u32 = 160;
/// Violation that counts as rounding, relative to the largest bound or reference times the normal, from which
/// z is computed. It is far above 1e-16 times the condition of a program of limbs (1e3). So equivalent
/// constraints, like the two bounds of a fixed unknown, do not contradict each other.
const ROUNDING: f64 = 1e-12;
/// A normal counts as a combination of the active ones if its remainder, squared, is below this share of it.
/// This is an angle of 1e-10, far above rounding (1e-16 times the condition of H).
const DEPENDENT: f64 = 1e-20;

type Vector = [f64; UNKNOWNS];

/// A program. Every entry must be finite, `lower <= upper`, and H symmetric and positive definite.
#[derive(Clone, Debug)]
pub struct Problem {
    /// Number n of unknowns. Entries beyond it are not used.
    pub count: usize,
    /// The matrix H.
    pub hessian: [Vector; UNKNOWNS],
    /// r, the optimum without constraints.
    pub reference: Vector,
    /// Lower bounds of z.
    pub lower: Vector,
    /// Upper bounds of z.
    pub upper: Vector,
    /// The normals g_k.
    pub rows: [Vector; ROWS_MAX],
    /// The bounds c_k.
    pub least: [f64; ROWS_MAX],
    /// Number of valid rows.
    pub row_count: usize,
}

impl Default for Problem {
    fn default() -> Self {
        let mut hessian = [[0.0; UNKNOWNS]; UNKNOWNS];
        for (i, row) in hessian.iter_mut().enumerate() {
            row[i] = 1.0;
        }
        Self {
            count: UNKNOWNS,
            hessian,
            reference: [0.0; UNKNOWNS],
            lower: [0.0; UNKNOWNS],
            upper: [0.0; UNKNOWNS],
            rows: [[0.0; UNKNOWNS]; ROWS_MAX],
            least: [0.0; ROWS_MAX],
            row_count: 0,
        }
    }
}

/// Result of the solver.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Status {
    /// `z` is the optimum.
    Optimal,
    /// No z meets all constraints.
    Infeasible,
    /// The solver gave up after [`STEPS_MAX`] steps, or H is not positive definite.
    Unsolved,
}

/// Solution of the solver.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Solution {
    /// Result. `z` is valid only if it is optimal.
    pub status: Status,
    /// The unknowns.
    pub z: Vector,
    /// Steps taken.
    pub steps: u32,
}

/// The constraints that were active at a solution.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ActiveSet(u128);

impl ActiveSet {
    /// Returns true if row `k` of the problem is in the set.
    pub fn has_row(self, k: usize) -> bool {
        self.0 & 1 << (2 * UNKNOWNS + k) != 0
    }

    /// Adds row `k` to the set.
    pub fn add_row(&mut self, k: usize) {
        self.0 |= 1 << (2 * UNKNOWNS + k);
    }

    /// Returns the set without rows. Use it if a problem has the same bounds as the last one, but other rows.
    pub fn bounds_only(self) -> Self {
        Self(self.0 & ((1 << (2 * UNKNOWNS)) - 1))
    }
}

/// Solves `problem`. `warm` holds the constraints that were active before, and is set to those that are active now.
pub fn solve(problem: &Problem, warm: &mut ActiveSet) -> Solution {
    let mut work = Work::new(problem);
    let unsolved = |work: &Work<'_>, status| Solution { status, z: work.z, steps: work.steps };
    if !work.factorise() {
        return unsolved(&work, Status::Unsolved);
    }
    while let Some(violated) = work.most_violated(*warm) {
        match work.enforce(violated) {
            Status::Optimal => {}
            status => return unsolved(&work, status),
        }
    }
    *warm = ActiveSet(work.members);
    Solution { status: Status::Optimal, z: work.z, steps: work.steps }
}

struct Work<'a> {
    problem: &'a Problem,
    z: Vector,
    /// The largest bound or reference.
    scale: f64,
    /// Column c of J.
    basis: [Vector; UNKNOWNS],
    /// R, upper triangular: `r[row][column]`.
    r: [Vector; UNKNOWNS],
    /// The active constraints in the order of R's columns, and their multipliers.
    active: [usize; UNKNOWNS],
    multiplier: Vector,
    len: usize,
    /// The active constraints as a set.
    members: u128,
    steps: u32,
}

impl<'a> Work<'a> {
    fn new(problem: &'a Problem) -> Self {
        let largest = |of: &Vector| of.iter().fold(0.0_f64, |most, x| most.max(x.abs()));
        Self {
            problem,
            z: problem.reference,
            scale: largest(&problem.reference).max(largest(&problem.lower)).max(largest(&problem.upper)),
            basis: [[0.0; UNKNOWNS]; UNKNOWNS],
            r: [[0.0; UNKNOWNS]; UNKNOWNS],
            active: [0; UNKNOWNS],
            multiplier: [0.0; UNKNOWNS],
            len: 0,
            members: 0,
            steps: 0,
        }
    }

    /// Sets J = L^-T: column c of J is row c of L^-1. Returns false if H is not positive definite.
    fn factorise(&mut self) -> bool {
        let mut l = [[0.0; UNKNOWNS]; UNKNOWNS];
        for i in 0..self.problem.count {
            for k in 0..=i {
                let sum: f64 = (0..k).map(|m| l[i][m] * l[k][m]).sum();
                let left = self.problem.hessian[i][k] - sum;
                if i == k {
                    // The condition is also false for NaN.
                    if !(left > 0.0 && left.is_finite()) {
                        return false;
                    }
                    l[i][i] = left.sqrt();
                } else {
                    l[i][k] = left / l[k][k];
                }
            }
        }
        for c in 0..self.problem.count {
            for i in 0..=c {
                let sum: f64 = (i..c).map(|m| l[c][m] * self.basis[m][i]).sum();
                self.basis[c][i] = (if c == i { 1.0 } else { 0.0 } - sum) / l[c][c];
            }
        }
        true
    }

    /// Returns n . z - b of a constraint, and the size of its possible rounding error.
    fn slack(&self, constraint: usize) -> (f64, f64) {
        let p = self.problem;
        let (value, bound, normal) = if constraint < UNKNOWNS {
            (self.z[constraint], p.lower[constraint], 1.0)
        } else if constraint < 2 * UNKNOWNS {
            let i = constraint - UNKNOWNS;
            (-self.z[i], -p.upper[i], 1.0)
        } else {
            let row = &p.rows[constraint - 2 * UNKNOWNS];
            let mut sums = (0.0, 0.0);
            for i in 0..p.count {
                sums = (sums.0 + row[i] * self.z[i], sums.1 + row[i].abs());
            }
            (sums.0, p.least[constraint - 2 * UNKNOWNS], sums.1)
        };
        (value - bound, ROUNDING * (normal * self.scale + bound.abs()))
    }

    /// Returns d = J^T n.
    fn project(&self, constraint: usize) -> Vector {
        let mut d = [0.0; UNKNOWNS];
        for (c, d) in d.iter_mut().enumerate().take(self.problem.count) {
            let column = &self.basis[c];
            *d = if constraint < UNKNOWNS {
                column[constraint]
            } else if constraint < 2 * UNKNOWNS {
                -column[constraint - UNKNOWNS]
            } else {
                let row = &self.problem.rows[constraint - 2 * UNKNOWNS];
                (0..self.problem.count).map(|i| column[i] * row[i]).sum()
            };
        }
        d
    }

    /// Returns the most violated constraint. It looks first among those of `warm`.
    fn most_violated(&self, warm: ActiveSet) -> Option<usize> {
        let count = 2 * UNKNOWNS + self.problem.row_count.min(ROWS_MAX);
        let worst = |among: u128| {
            let mut worst: Option<(f64, usize)> = None;
            let mut left = among & !self.members & (u128::MAX >> (128 - count));
            while left != 0 {
                let constraint = left.trailing_zeros() as usize;
                left &= left - 1;
                let (slack, rounding) = self.slack(constraint);
                if slack < -rounding && worst.is_none_or(|(least, _)| slack < least) {
                    worst = Some((slack, constraint));
                }
            }
            worst.map(|(_, constraint)| constraint)
        };
        worst(warm.0).or_else(|| worst(u128::MAX))
    }

    /// Moves to the optimum with `constraint` added. Active constraints whose multiplier would fall below
    /// zero are dropped.
    fn enforce(&mut self, constraint: usize) -> Status {
        let mut own = 0.0;
        loop {
            self.steps += 1;
            if self.steps > STEPS_MAX {
                return Status::Unsolved;
            }
            let d = self.project(constraint);
            let along = self.dual_direction(&d);
            let (mut blocking, mut dual_step) = (None, f64::INFINITY);
            for m in 0..self.len {
                if along[m] > 0.0 && self.multiplier[m] < dual_step * along[m] {
                    (blocking, dual_step) = (Some(m), self.multiplier[m] / along[m]);
                }
            }
            let free: f64 = d[self.len..].iter().map(|d| d * d).sum();
            let whole: f64 = d.iter().map(|d| d * d).sum();
            let full_step = if free > DEPENDENT * whole && self.len < self.problem.count {
                (-self.slack(constraint).0 / free).max(0.0)
            } else {
                f64::INFINITY
            };
            let step = dual_step.min(full_step);
            if !step.is_finite() {
                return Status::Infeasible;
            }
            if full_step.is_finite() {
                for c in self.len..self.problem.count {
                    for i in 0..self.problem.count {
                        self.z[i] += step * d[c] * self.basis[c][i];
                    }
                }
            }
            for m in 0..self.len {
                self.multiplier[m] -= step * along[m];
            }
            own += step;
            match blocking {
                Some(m) if dual_step < full_step => self.drop_active(m),
                _ => {
                    self.add_active(constraint, d, own);
                    return Status::Optimal;
                }
            }
        }
    }

    /// Returns R^-1 d1.
    fn dual_direction(&self, d: &Vector) -> Vector {
        let mut along = [0.0; UNKNOWNS];
        for row in (0..self.len).rev() {
            let sum: f64 = (row + 1..self.len).map(|c| self.r[row][c] * along[c]).sum();
            along[row] = (d[row] - sum) / self.r[row][row];
        }
        along
    }

    fn add_active(&mut self, constraint: usize, mut d: Vector, multiplier: f64) {
        for c in (self.len + 1..self.problem.count).rev() {
            if let Some((cos, sin)) = rotation(d[c - 1], d[c]) {
                d[c - 1] = cos * d[c - 1] + sin * d[c];
                self.rotate_basis(c - 1, cos, sin);
            }
        }
        for row in 0..=self.len {
            self.r[row][self.len] = d[row];
        }
        self.active[self.len] = constraint;
        self.multiplier[self.len] = multiplier;
        self.members |= 1 << constraint;
        self.len += 1;
    }

    fn drop_active(&mut self, m: usize) {
        self.members &= !(1 << self.active[m]);
        self.len -= 1;
        for c in m..self.len {
            self.active[c] = self.active[c + 1];
            self.multiplier[c] = self.multiplier[c + 1];
            for row in 0..=c + 1 {
                self.r[row][c] = self.r[row][c + 1];
            }
        }
        for row in m..self.len {
            let Some((cos, sin)) = rotation(self.r[row][row], self.r[row + 1][row]) else { continue };
            for c in row..self.len {
                let (upper, lower) = (self.r[row][c], self.r[row + 1][c]);
                self.r[row][c] = cos * upper + sin * lower;
                self.r[row + 1][c] = cos * lower - sin * upper;
            }
            self.rotate_basis(row, cos, sin);
        }
    }

    /// Turns columns `first` and `first + 1` of J.
    fn rotate_basis(&mut self, first: usize, cos: f64, sin: f64) {
        for i in 0..self.problem.count {
            let (a, b) = (self.basis[first][i], self.basis[first + 1][i]);
            self.basis[first][i] = cos * a + sin * b;
            self.basis[first + 1][i] = cos * b - sin * a;
        }
    }
}

/// The rotation that takes (a, b) to (length, 0). None if b is zero already.
fn rotation(a: f64, b: f64) -> Option<(f64, f64)> {
    if b == 0.0 {
        return None;
    }
    let length = a.hypot(b);
    Some((a / length, b / length))
}

const _: () = assert!(CONSTRAINTS < 128, "a set of constraints fits into 128 bits");
