//! Shares of three key poses: a point in the triangle of the key poses, and its largest speed.

/// Shares of the three key poses: none is negative, their sum is 1.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Shares([f64; 3]);

/// Requests are clamped to this distance. For every reasonable request the nearest point of the triangle stays
/// the same up to rounding.
const FAR: f64 = 1e3;

impl Shares {
    /// The first key pose only.
    pub const FIRST: Self = Self([1.0, 0.0, 0.0]);

    /// Returns the point of the triangle nearest to `asked`. `None` if a number is not finite. The projection onto the
    /// simplex is w_i = max(x_i - theta, 0), with the one theta that makes their sum 1 (Held, Wolfe and Crowder 1974).
    pub fn nearest(asked: [f64; 3]) -> Option<Self> {
        if !asked.iter().all(|x| x.is_finite()) {
            return None;
        }
        let asked = asked.map(|x| x.clamp(-FAR, FAR));
        let mut sorted = asked;
        sorted.sort_by(|a, b| b.total_cmp(a));
        let (mut sum, mut theta) = (0.0, 0.0);
        for (n, x) in sorted.into_iter().enumerate() {
            sum += x;
            let candidate = (sum - 1.0) / (n + 1) as f64;
            if x > candidate {
                theta = candidate;
            }
        }
        Some(Self(asked.map(|x| (x - theta).max(0.0))))
    }

    /// Moves from here toward `to` on the straight line. No share changes by more than `step`.
    pub fn toward(self, to: Self, step: f64) -> Self {
        let change: [f64; 3] = std::array::from_fn(|i| to.0[i] - self.0[i]);
        let most = change.iter().fold(0.0_f64, |most, x| most.max(x.abs()));
        if most <= step { to } else { Self(std::array::from_fn(|i| self.0[i] + change[i] * (step / most))) }
    }

    /// Returns the shares in the order of the key poses.
    pub const fn get(self) -> [f64; 3] {
        self.0
    }
}
