//! Detects a single position that is far from where the joint could have moved, and predicts a better one.
//!
//! The Hampel identifier calls a value an outlier if it is further than k 1.4826 MAD from the median of its
//! window. MAD is the window's median absolute deviation. Sources: Hampel, The Influence Curve and its Role in
//! Robust Estimation, 1974, and Pearson, Outliers in Process Modeling and Identification, IEEE Transactions on
//! Control Systems Technology 10(1), 2002. Here it is causal, and it judges residuals. r is the distance (m) from
//! the new position to the nearest of a few predictions. Each prediction continues earlier positions at constant
//! velocity. A residual deviates from 0, so MAD is the median of the last N:
//!
//! ```text
//! outlier: r > max(k 1.4826 median(r_1 .. r_N), u T)
//! ```
//!
//! u T is the largest deviation of strong motion from constant velocity within the time T. An outlier is held at the
//! nearest prediction for one frame. The next position is accepted in any case.

use messages::Stamp;

/// Number of residuals per joint, N. Assumption: a quarter of a second of a camera, of which three may be outliers.
const WINDOW: usize = 7;
/// Standard deviation of normal noise per median absolute deviation: 1 / Phi^-1(3 / 4) (Hampel). A distance in space is
/// larger than its coordinates. So k is more than k standard deviations of one coordinate: 2.3 times as many.
const SIGMA_PER_MAD: f64 = 1.4826;
/// Change of velocity within a frame that always counts as motion, u, m/s. Of the joints of 61 recorded clips of
/// CMU fewer than 1 in 1000 exceed it at 30 and at 60 Hz (`examples/outliers.rs`).
const VELOCITY_CHANGE_M_PER_S: f64 = 1.8;
/// Number of positions that a prediction uses.
const PLACES: usize = 4;
/// Largest time for a prediction, in periods between those positions: one frame may be lost.
const PERIODS_MAX: f64 = 2.5;

/// A position of a joint, m, and its time.
#[derive(Clone, Copy, Debug, Default)]
struct Place {
    at: Stamp,
    m: [f64; 3],
}

/// Distance between two positions, m.
pub(crate) fn distance(a: [f64; 3], b: [f64; 3]) -> f64 {
    (0..3).map(|i| (a[i] - b[i]).powi(2)).sum::<f64>().sqrt()
}

/// Extrapolates the least-squares line through positions to the time `at`, m. `at` must be later than all of them.
fn ahead(places: &[Place], at: Stamp) -> [f64; 3] {
    let ago_s = |place: &Place| at.since(place.at) as f64 * 1e-9;
    let count = places.len() as f64;
    let middle_s = places.iter().map(ago_s).sum::<f64>() / count;
    let spread = places.iter().map(|place| (ago_s(place) - middle_s).powi(2)).sum::<f64>();
    std::array::from_fn(|i| {
        let mean = places.iter().map(|place| place.m[i]).sum::<f64>() / count;
        let slope = places.iter().map(|place| (ago_s(place) - middle_s) * place.m[i]).sum::<f64>() / spread;
        mean - slope * middle_s
    })
}

/// State for one joint.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Past {
    /// The last positions, with outliers replaced, the newest first.
    places: [Place; PLACES],
    known: usize,
    /// The last residuals, m, in a ring, and the number of all residuals so far.
    residuals: [f64; WINDOW],
    judged: usize,
    /// True if the previous frame was held.
    held: bool,
}

impl Past {
    /// Returns the position at which the joint is held if the new one is an outlier. `None` if the new one is accepted.
    /// `k` is the bound in deviations. It never holds twice in a row, nor before the window of residuals is full.
    pub(crate) fn hold(&mut self, k: f64, at: Stamp, came: [f64; 3]) -> Option<[f64; 3]> {
        let outlier = self.judge(k, at, came).filter(|_| !self.held);
        self.held = outlier.is_some();
        self.places.rotate_right(1);
        self.places[0] = Place { at, m: outlier.unwrap_or(came) };
        self.known = (self.known + 1).min(PLACES);
        outlier
    }

    /// Returns the nearest prediction if the new position is an outlier. Stores the residual.
    fn judge(&mut self, k: f64, at: Stamp, came: [f64; 3]) -> Option<[f64; 3]> {
        let [newest, .., oldest] = self.places;
        let (passed_ns, period_ns) =
            (at.since(newest.at) as f64, newest.at.since(oldest.at) as f64 / (PLACES - 1) as f64);
        if self.known < PLACES || passed_ns > PERIODS_MAX * period_ns {
            return None;
        }
        // The last two positions alone show the newest turn. The two before them are free of an outlier that was
        // accepted last. The line through all has the least noise. And a joint may stop.
        let ways = [ahead(&self.places[..2], at), ahead(&self.places[1..3], at), ahead(&self.places, at), newest.m];
        let nearer = |a: [f64; 3], b: [f64; 3]| if distance(b, came) < distance(a, came) { b } else { a };
        let nearest = ways.into_iter().fold(newest.m, nearer);
        let residual = distance(nearest, came);
        let bound_m = self.bound_m(k, passed_ns.max(period_ns) * 1e-9);
        self.residuals[self.judged % WINDOW] = residual;
        self.judged += 1;
        bound_m.filter(|bound_m| residual > *bound_m).map(|_| nearest)
    }

    /// Returns the largest residual of a normal position, m, after this time.
    fn bound_m(&self, k: f64, period_s: f64) -> Option<f64> {
        let mut sorted = self.residuals;
        sorted.sort_unstable_by(f64::total_cmp);
        let sigma = SIGMA_PER_MAD * sorted[WINDOW / 2];
        (self.judged >= WINDOW).then(|| (k * sigma).max(VELOCITY_CHANGE_M_PER_S * period_s))
    }
}
