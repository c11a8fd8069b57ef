//! The three networks of the shared latent space at batch one or two, without allocation.

pub(crate) mod golden;
use perceptron::{Dense, Perceptron};

use crate::arm::{ARM_Q, ARMS, ArmModel, ArmQ, FEATURES};

/// Dimension of the shared latent space, one arm: the paper's (ImitationNet, 2023).
pub const LATENT: usize = 8;
/// Largest number of hidden layers: more than twice the paper's 6.
pub const HIDDEN_MAX: usize = 16;
/// Range of the decoder relative to the limits. It exceeds 1, so finite activations reach the limits.
pub const OVERREACH: f64 = 1.02;

/// A point of the shared latent space.
pub type Latent = [f32; LATENT];

/// Returns the point at `s` on the straight line from `a` (0) to `b` (1).
pub fn interpolate_latent(a: &Latent, b: &Latent, s: f64) -> Latent {
    let s = s as f32;
    std::array::from_fn(|i| a[i] + (b[i] - a[i]) * s)
}

/// All layers of the three networks, from input to output.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Layers {
    /// Q_h: 12 features to the latent.
    pub human: Vec<Dense>,
    /// Q_r: five normalised joint positions to the latent.
    pub robot: Vec<Dense>,
    /// D_r: latent to five joint activations.
    pub decoder: Vec<Dense>,
}

/// The networks, ready to run. Of several arms, left and right ones come in turn.
#[derive(Clone, Debug)]
pub struct Network {
    human: Perceptron,
    robot: Perceptron,
    decoder: Perceptron,
    mid: ArmQ,
    half: ArmQ,
    q_min: ArmQ,
    q_max: ArmQ,
    /// The networks of right arms that do not mirror the left one.
    right: Option<Box<Self>>,
}

impl Network {
    /// Packs checked layers for `arm`, for the widest vectors of this processor. The caller must check the shapes, as
    /// `Weights` does.
    ///
    /// # Panics
    /// Panics if layers do not fit together or are wider than `WIDTH_MAX`: a bug of the caller.
    pub fn new(layers: &Layers, arm: &ArmModel) -> Self {
        let pack = |layers: &[Dense], inputs: usize, outputs: usize| {
            let packed = Perceptron::new(layers);
            assert!((packed.inputs(), packed.outputs()) == (inputs, outputs), "layers fit the networks");
            packed
        };
        Self {
            human: pack(&layers.human, FEATURES, LATENT),
            robot: pack(&layers.robot, ARM_Q, LATENT),
            decoder: pack(&layers.decoder, LATENT, ARM_Q),
            mid: arm.mid(),
            half: arm.half(),
            q_min: arm.q_min,
            q_max: arm.q_max,
            right: None,
        }
    }

    /// Adds the networks of a right arm that does not mirror the left one.
    #[must_use]
    pub fn with_right(self, right: Self) -> Self {
        Self { right: Some(Box::new(right)), ..self }
    }

    /// Replaces what right arms of their own have of these outputs.
    fn own_right<O: Copy, const N: usize>(&self, outputs: [O; N], run: impl Fn(&Self, usize) -> O) -> [O; N] {
        let own = |n: usize| self.right.as_deref().filter(|_| n % ARMS == 1).map(|right| run(right, n));
        std::array::from_fn(|n| own(n).unwrap_or(outputs[n]))
    }

    /// Q_h: encodes the features of `N` arms to latents.
    pub fn encode_human<const N: usize>(&self, features: &[[f32; FEATURES]; N]) -> [Latent; N] {
        self.own_right(self.human.forward(features), |right, n| right.encode_human(&[features[n]])[0])
    }

    /// Q_r: encodes the postures of `N` arms, rad, to latents. The network's input is (q - mid) / half.
    pub fn encode_robot<const N: usize>(&self, q: &[ArmQ; N]) -> [Latent; N] {
        // An empty slot has no range.
        let normalised =
            |j: usize, q: f64| if self.half[j] > 0.0 { ((q - self.mid[j]) / self.half[j]) as f32 } else { 0.0 };
        let input: [[f32; ARM_Q]; N] = std::array::from_fn(|n| std::array::from_fn(|j| normalised(j, q[n][j])));
        self.own_right(self.robot.forward(&input), |right, n| right.encode_robot(&[q[n]])[0])
    }

    /// D_r: decodes the latents of `N` arms to postures within the limits, rad: mid + 1.02 half tanh(y), clamped.
    /// The result is not finite if the latent or the weights are not.
    pub fn decode<const N: usize>(&self, latents: &[Latent; N]) -> [ArmQ; N] {
        let y: [[f32; ARM_Q]; N] = self.decoder.forward(latents);
        let postures = std::array::from_fn(|n| {
            std::array::from_fn(|j| {
                let q = self.mid[j] + OVERREACH * self.half[j] * f64::from(tanh(y[n][j]));
                // Not `clamp`: a NaN must pass, so the tick sees it.
                if q < self.q_min[j] {
                    self.q_min[j]
                } else if q > self.q_max[j] {
                    self.q_max[j]
                } else {
                    q
                }
            })
        });
        self.own_right(postures, |right, n| right.decode(&[latents[n]])[0])
    }
}

/// 1 - 2 / (1 + exp(2 x)). The absolute error is below 2e-7, which is enough for a joint position.
fn tanh(x: f32) -> f32 {
    1.0 - 2.0 / (1.0 + exp(2.0 * x))
}

/// exp without a branch: x = n ln 2 + r, 2^n by the exponent bits, exp(r) by the polynomial of Cephes `expf`
/// (relative error 2e-7). It saturates at exp(+-87) and passes NaN.
#[expect(clippy::excessive_precision, reason = "coefficients as published")]
fn exp(x: f32) -> f32 {
    /// 1.5 * 2^23: adding it rounds to an integer and leaves that integer in the low mantissa bits.
    const ROUND: f32 = 12_582_912.0;
    let x = if x < -87.0 { -87.0 } else { x };
    let x = if x > 87.0 { 87.0 } else { x };
    let shifted = x * std::f32::consts::LOG2_E + ROUND;
    let n = shifted - ROUND;
    let r = x - n * 0.693_359_375 + n * 2.121_944_4e-4;
    let p = 1.987_569_15e-4_f32;
    let p = p * r + 1.398_199_95e-3;
    let p = p * r + 8.333_451_907_3e-3;
    let p = p * r + 4.166_579_589_4e-2;
    let p = p * r + 1.666_666_545_9e-1;
    let p = p * r + 5.000_000_120_1e-1;
    let exp_r = p * r * r + r + 1.0;
    exp_r * f32::from_bits(shifted.to_bits().wrapping_add(127) << 23)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exp_is_within_3_ulp_of_exact_value() {
        for i in -86_000..=86_000 {
            let x = i as f32 * 1e-3;
            let want = f64::from(x).exp();
            let error = (f64::from(exp(x)) - want).abs() / want;
            assert!(error < 3.6e-7, "exp({x}) is off by {error:e}");
        }
        assert!(exp(f32::NAN).is_nan());
        assert!(exp(1e30).is_finite() && exp(-1e30) > 0.0);
    }
}
