//! Bounds of the pairs' distances that the gate knows before it measures any. With them most pairs need no measurement.
//!
//! A pair was D apart, or at least D, at some judged command. Since then joint k has moved by d_k from one judged command
//! to the next. By the levers R_k (see `body`) the pair is now at least
//!
//! ```text
//! bound = D - sum over the commands since, and the joints k between its bodies, of R_k |d_k|
//! ```
//!
//! apart, on whatever way the robot came here: the levers bound the change between any two postures. The sums are kept
//! per body, with the largest lever of its capsules. No speed is assumed.
//!
//! # Same verdicts
//!
//! A bound never takes the place of a distance. A pair is skipped if its bound is at least what it needs, and more than the
//! least distance so far. Its measured distance would be so too. So the pair would neither be left open nor be the nearest
//! one. Any other pair is measured. A distance errs by less than 1e-12 m. A sum begins again after [`MOVES_MAX`] commands, and after any
//! move above [`MOVE_MAX`]. It then errs by less than 6e-7 m. [`SPARE_M`] is more than both. A test judges the same
//! commands with and without bounds.

use messages::JOINTS_MAX;

use super::body::{Body, NO_ROWS, Rows};
use super::fixed::{Point, UNITS};

/// Part of a bound that is not used, m. See the module's text.
const SPARE_M: f64 = 1e-6;
/// Commands after which the sums begin again. At levers of 10 m they add up to 7e4 m. A sum that size errs by 4e-12 m per
/// command.
const MOVES_MAX: u32 = 1 << 16;
/// Largest move of a joint between two commands that a bound may survive, rad or m: 150 rad/s for a tick.
const MOVE_MAX: f64 = 0.1;

/// Lower bounds of all distances at the last judged command.
#[derive(Clone, Debug)]
pub(super) struct Known {
    /// Positions of that command, in units.
    q: [i64; JOINTS_MAX],
    moves: u32,
    /// Paths of the bodies so far, m.
    paths: Rows,
    /// For each pair, its distance when it was last measured plus the paths of both sides then, m.
    bounds: Vec<f64>,
}

impl Known {
    pub(super) fn nothing(pairs: usize) -> Self {
        Self { q: [0; JOINTS_MAX], moves: MOVES_MAX, paths: NO_ROWS, bounds: vec![f64::NEG_INFINITY; pairs] }
    }

    /// Moves on to the command `next`.
    pub(super) fn go(&mut self, body: &Body, next: &[Point; JOINTS_MAX]) {
        let moved: [f64; JOINTS_MAX] = std::array::from_fn(|j| (next[j].q - self.q[j]).abs() as f64 / UNITS);
        self.q = next.map(|point| point.q);
        self.moves = self.moves.saturating_add(1);
        if self.moves > MOVES_MAX || moved.iter().any(|&moved| moved > MOVE_MAX) {
            self.moves = 0;
            self.paths = NO_ROWS;
            self.bounds.fill(f64::NEG_INFINITY);
        } else {
            body.move_by(&moved, &mut self.paths);
        }
    }

    /// Lower bound of a pair's distance, m.
    #[inline]
    pub(super) fn bound_m(&self, body: &Body, pair: usize) -> f64 {
        self.bounds[pair] - body.change(pair, &self.paths) - SPARE_M
    }

    /// Takes note of a pair's distance at the last command, or of a lower bound of it, m.
    #[inline]
    pub(super) fn set(&mut self, body: &Body, pair: usize, distance_m: f64) {
        self.bounds[pair] = distance_m + body.change(pair, &self.paths);
    }
}
