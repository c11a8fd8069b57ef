//! Noise of the encoders.

use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64;

/// A source of normal random numbers, the same for the same seed.
#[derive(Clone, Debug)]
pub(crate) struct Noise(Pcg64);

impl Noise {
    pub(crate) fn new(seed: u64) -> Self {
        Self(Pcg64::seed_from_u64(seed))
    }

    /// Returns two independent standard normal numbers (Box and Muller, 1958).
    pub(crate) fn pair(&mut self) -> (f64, f64) {
        // 53 bits in (0, 1], so the logarithm is finite.
        let mut uniform = || ((self.0.next_u64() >> 11) + 1) as f64 / (1_u64 << 53) as f64;
        let radius = (-2.0 * uniform().ln()).sqrt();
        let (sin, cos) = (std::f64::consts::TAU * uniform()).sin_cos();
        (radius * cos, radius * sin)
    }
}
