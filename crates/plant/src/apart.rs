//! Lower bounds of the distances of pairs, so that a judge need not measure those that cannot be the nearest.
//!
//! A point of a capsule's axis lies between its two ends. So from one look to the next it moves by at most the greater of the
//! two ends' moves. The distance of two capsules falls by at most the sum of both capsules' moves. A pair that was D apart is
//! now at least D minus both sums of moves since then. An obstacle does not move.
//!
//! A judge measures every pair that may be as near as the nearest so far. So it finds the same least distance as one that
//! measures all. A sum of [`LOOKS_MAX`] moves of at most [`MOVE_MAX_M`] errs by less than 1e-7 m, and a distance by less
//! than 1e-9 m. [`SPARE_M`] is more than both.

/// Part of a bound that is not used, m.
const SPARE_M: f64 = 1e-6;
/// Looks after which the sums begin again.
const LOOKS_MAX: u32 = 1 << 16;
/// Largest move of an end that a bound may survive, m: 75 m/s for a tick.
const MOVE_MAX_M: f64 = 0.05;

/// Bounds for the pairs of some capsules. Capsule `capsules` stands still.
#[derive(Clone, Debug)]
pub struct Apart {
    paths: Vec<f64>,
    /// For each pair, its distance when it was last measured plus the paths of both sides then, m.
    bounds: Vec<f64>,
    looks: u32,
    /// The pair that was nearest. A judge measures it first.
    pub nearest: usize,
}

impl Apart {
    /// Creates bounds that say nothing yet.
    pub fn new(capsules: usize, pairs: usize) -> Self {
        Self {
            paths: vec![0.0; capsules + 1],
            bounds: vec![f64::NEG_INFINITY; pairs],
            looks: LOOKS_MAX,
            nearest: usize::MAX,
        }
    }

    /// Takes a look. `moves` are the squares of how far both ends of each capsule moved, m^2.
    pub fn look(&mut self, moves: impl Iterator<Item = [f64; 2]>) {
        self.looks += 1;
        let mut kept = self.looks <= LOOKS_MAX;
        for (path, [a, b]) in self.paths.iter_mut().zip(moves) {
            // False for NaN.
            kept &= a + b <= MOVE_MAX_M * MOVE_MAX_M;
            *path += a.max(b).sqrt();
        }
        if !kept {
            self.looks = 0;
            self.paths.fill(0.0);
            self.bounds.fill(f64::NEG_INFINITY);
        }
    }

    /// Returns true if a pair of two capsules is farther apart than `distance_m`.
    #[inline]
    pub fn is_beyond(&self, pair: usize, [a, b]: [usize; 2], distance_m: f64) -> bool {
        self.bounds[pair] - self.paths[a] - self.paths[b] > distance_m
    }

    /// Takes note of the distance of a pair, m.
    #[inline]
    pub fn set(&mut self, pair: usize, [a, b]: [usize; 2], distance_m: f64) {
        self.bounds[pair] = distance_m - SPARE_M + self.paths[a] + self.paths[b];
    }
}
