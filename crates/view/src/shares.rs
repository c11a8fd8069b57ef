//! Shares of three key poses: a point in the triangle of the key poses, and its largest speed.

/// Shares of the three key poses: none is negative, their sum is 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shares([f64; 3]);

/// Requests are clamped to this distance. For every reasonable request the nearest point of the triangle stays
/// the same up to rounding.
const FAR: f64 = 1e3;

impl Shares {
    /// The first key pose only.
    pub const FIRST: Self = Self([1.0, 0.0, 0.0]);

    /// Returns the point of the triangle nearest to `asked`. `None` if a number is not finite. The projection
    /// onto the simplex is w_i = max(x_i - theta, 0), with the one theta that makes their sum 1 (Held, Wolfe and
    /// Crowder 1974).
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

#[cfg(test)]
mod tests {
    use super::*;

    /// A linear congruential generator (Knuth, MMIX) with values from -2 to 2.
    fn draw(seed: &mut u64) -> f64 {
        *seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (*seed >> 11) as f64 / (1_u64 << 53) as f64 * 4.0 - 2.0
    }

    fn is_in_triangle(shares: Shares) -> bool {
        shares.get().iter().all(|&x| (0.0..=1.0 + 1e-9).contains(&x))
            && (shares.get().iter().sum::<f64>() - 1.0).abs() < 1e-9
    }

    #[test]
    fn nearest_share_is_in_triangle_and_non_finite_is_refused() {
        for asked in [[1.0, 0.0, 0.0], [0.25, 0.25, 0.5], [0.0, 0.5, 0.5]] {
            assert_eq!(Shares::nearest(asked).map(Shares::get), Some(asked), "what is in it stays");
        }
        for (asked, becomes) in [
            ([0.0, 0.0, 0.0], [1.0 / 3.0; 3]),
            ([7.0, 0.0, 0.0], [1.0, 0.0, 0.0]),
            ([-1.0, 0.6, 0.6], [0.0, 0.5, 0.5]),
            ([f64::MAX, f64::MIN, 0.0], [1.0, 0.0, 0.0]),
            ([1e300, 1e300, -1e300], [0.5, 0.5, 0.0]),
        ] {
            let found = Shares::nearest(asked).expect("numbers").get();
            assert!(found.iter().zip(becomes).all(|(a, b)| (a - b).abs() < 1e-9), "{asked:?}: {found:?}");
        }
        for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            assert_eq!(Shares::nearest([bad, 0.5, 0.5]), None);
            assert_eq!(Shares::nearest([0.0, 1.0, bad]), None);
        }
        let mut seed = 3;
        for _ in 0..100_000 {
            let asked = [draw(&mut seed), draw(&mut seed), draw(&mut seed)];
            let found = Shares::nearest(asked).expect("numbers");
            assert!(is_in_triangle(found), "{asked:?}: {found:?}");
            // This point is nearest: no step from it into the triangle comes nearer.
            let away = |point: [f64; 3]| -> f64 { point.iter().zip(asked).map(|(a, b)| (a - b).powi(2)).sum() };
            for corner in [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]] {
                let beside = std::array::from_fn(|i| found.get()[i] + 1e-3 * (corner[i] - found.get()[i]));
                assert!(away(beside) >= away(found.get()) - 1e-12, "{asked:?}: {found:?}");
            }
        }
    }

    #[test]
    fn shares_move_by_one_step_at_most_and_reach_their_goal() {
        let step = 1.0 / 120.0;
        let (mut seed, mut at) = (5, Shares::FIRST);
        for _ in 0..2000 {
            let to = Shares::nearest([draw(&mut seed), draw(&mut seed), draw(&mut seed)]).expect("numbers");
            for _ in 0..1 + (draw(&mut seed).abs() * 60.0) as usize {
                let next = at.toward(to, step);
                let moved = (0..3).map(|i| (next.get()[i] - at.get()[i]).abs()).fold(0.0, f64::max);
                assert!(moved <= step + 1e-12 && is_in_triangle(next), "{at:?} to {next:?}");
                at = next;
            }
        }
        let to = Shares::nearest([0.0, 1.0, 0.0]).expect("numbers");
        let mut at = Shares::FIRST;
        for n in 1..=120 {
            at = at.toward(to, step);
            let along = f64::from(n) / 120.0;
            assert!((at.get()[1] - along).abs() < 1e-9 && at.get()[2] == 0.0, "{n}: {at:?}");
        }
        assert!((at.get()[1] - 1.0).abs() < 1e-9);
        assert_eq!(at.toward(to, step), to, "it arrives, and not only nearly");
    }
}
