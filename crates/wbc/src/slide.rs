//! Sliding along an obstacle: the wanted velocity without the part that leads into the pairs that could not be proved.
//!
//! For each such pair with distance d and gradient g = dd/dq, a row g . v >= c with c = -rate (d - d_min - margin):
//! approach slows down with the distance that is left, and below the margin the pair opens. A violated row is met by
//! the smallest change of v, measured in shares of each joint's largest speed: v += W g (c - g . v) / (g . W g), W =
//! diag(v_max^2). The rows are visited in turn for a bounded number of rounds. Whether the result is safe is for the
//! certificate to say; this only proposes.

use crate::clearance::Anchor;
use crate::config::Config;
use messages::JOINTS;

/// Pairs that are slid along at once: hand against torso, forearm against base, and the other arm.
pub(crate) const ROWS_MAX: usize = 3;
/// Rounds over the rows: with three rows the remaining violation is then far below what the certificate's slack
/// forgives.
const ROUNDS: usize = 8;
/// Approach per distance left, 1/s: a tenth of the position gain's bandwidth would be timid, all of it would be denied.
const RATE_PER_S: f64 = 8.0;
/// Distance beyond d_min below which a pair is opened, m: what a barrier of the full program keeps as well.
const MARGIN_M: f64 = 3e-3;

/// A row g . v >= c.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Row {
    pair: usize,
    g: [f64; JOINTS],
    c: f64,
}

/// The rows of one tick.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Rows {
    rows: [Row; ROWS_MAX],
    len: usize,
}

impl Rows {
    pub(crate) const NONE: Self = Self { rows: [Row { pair: 0, g: [0.0; JOINTS], c: 0.0 }; ROWS_MAX], len: 0 };

    /// Adds a pair; false if it is there already, or there is no room: then another attempt would be the same one.
    pub(crate) fn add(&mut self, config: &Config, anchor: &Anchor, pair: usize) -> bool {
        if self.len == ROWS_MAX || self.rows[..self.len].iter().any(|row| row.pair == pair) {
            return false;
        }
        let left = anchor.separation[pair] - config.geometry.d_min_m - MARGIN_M;
        self.rows[self.len] = Row { pair, g: anchor.gradient(&config.geometry, pair), c: -RATE_PER_S * left };
        self.len += 1;
        true
    }

    /// Changes `v` until it meets the rows, or the rounds are over.
    pub(crate) fn slide(&self, config: &Config, v: &mut [f64; JOINTS]) {
        for row in (0..ROUNDS).flat_map(|_| &self.rows[..self.len]) {
            let (mut along, mut size) = (0.0, 0.0);
            for j in 0..JOINTS {
                along += row.g[j] * v[j];
                size += row.g[j].powi(2) * config.bounds[j].v_max.powi(2);
            }
            if along >= row.c || size <= 0.0 {
                continue;
            }
            let step = (row.c - along) / size;
            for j in 0..JOINTS {
                v[j] += step * row.g[j] * config.bounds[j].v_max.powi(2);
            }
        }
    }
}
