//! The three networks of the shared latent space at batch one or two: f32, allocation-free. The widest vectors of the
//! processor are used, and all of them give the same bits: sums run in one order and no multiply-add is fused.

use bytemuck::{Pod, Zeroable};
use pulp::{Simd, WithSimd};

use crate::arm::{ARM_Q, ArmModel, ArmQ, FEATURES};

/// Dimension of the shared latent space, one arm: the paper's (ImitationNet, 2023).
pub const LATENT: usize = 8;
/// Widest hidden layer that the fixed buffers take: four times the paper's 128.
pub const WIDTH_MAX: usize = 512;
/// Most hidden layers: above twice the paper's 6.
pub const HIDDEN_MAX: usize = 16;
/// Range of the decoder beyond the limits, so that the limits are reached at finite activations.
pub const OVERREACH: f64 = 1.02;

/// A point of the shared latent space.
pub type Latent = [f32; LATENT];

/// The point at `s` on the straight line from `a` (0) to `b` (1).
pub fn interpolate_latent(a: &Latent, b: &Latent, s: f64) -> Latent {
    let s = s as f32;
    std::array::from_fn(|i| a[i] + (b[i] - a[i]) * s)
}

/// One fully connected layer as training writes it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Dense {
    /// Number of inputs.
    pub inputs: usize,
    /// Number of outputs.
    pub outputs: usize,
    /// `[outputs][inputs]`, row-major.
    pub weight: Vec<f32>,
    /// `[outputs]`.
    pub bias: Vec<f32>,
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

/// 16 numbers on one cache line.
#[repr(C, align(64))]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct Line([f32; 16]);

const LINE: usize = 16;

/// A layer inside the arena: bias lines, then panels of up to 8 lines, each k-major.
#[derive(Clone, Copy, Debug)]
struct Layer {
    inputs: usize,
    lines: usize,
    at: usize,
    hidden: bool,
}

/// The networks, ready to run: one arena of cache lines, weights in the order in which they are read.
#[derive(Clone, Debug)]
pub struct Network {
    level: pulp::Arch,
    arena: Vec<Line>,
    human: Vec<Layer>,
    robot: Vec<Layer>,
    decoder: Vec<Layer>,
    mid: ArmQ,
    half: ArmQ,
    q_min: ArmQ,
    q_max: ArmQ,
}

impl Network {
    /// Packs checked layers for `arm`. Shapes are the caller's duty (`Weights` checks them).
    ///
    /// # Panics
    /// If layers do not fit together or are wider than `WIDTH_MAX`: a bug of the caller.
    pub fn new(layers: &Layers, arm: &ArmModel) -> Self {
        let mut arena = Vec::new();
        let human = pack(&layers.human, FEATURES, LATENT, &mut arena);
        let robot = pack(&layers.robot, ARM_Q, LATENT, &mut arena);
        let decoder = pack(&layers.decoder, LATENT, ARM_Q, &mut arena);
        Self {
            level: pulp::Arch::new(),
            arena,
            human,
            robot,
            decoder,
            mid: arm.mid(),
            half: arm.half(),
            q_min: arm.q_min,
            q_max: arm.q_max,
        }
    }

    /// Q_h: features of `N` arms to their latents.
    pub fn encode_human<const N: usize>(&self, features: &[[f32; FEATURES]; N]) -> [Latent; N] {
        self.run(&self.human, features)
    }

    /// Q_r: postures of `N` arms, rad, to their latents; the network sees (q - mid) / half.
    pub fn encode_robot<const N: usize>(&self, q: &[ArmQ; N]) -> [Latent; N] {
        let input: [[f32; ARM_Q]; N] =
            std::array::from_fn(|n| std::array::from_fn(|j| ((q[n][j] - self.mid[j]) / self.half[j]) as f32));
        self.run(&self.robot, &input)
    }

    /// D_r: latents of `N` arms to postures within the limits, rad: mid + 1.02 half tanh(y), clamped.
    /// Not finite if the latent or the weights are not.
    pub fn decode<const N: usize>(&self, latents: &[Latent; N]) -> [ArmQ; N] {
        let y: [[f32; ARM_Q]; N] = self.run(&self.decoder, latents);
        std::array::from_fn(|n| {
            std::array::from_fn(|j| {
                let q = self.mid[j] + OVERREACH * self.half[j] * f64::from(tanh(y[n][j]));
                // Not `clamp`: a NaN has to pass, so that the tick sees it.
                if q < self.q_min[j] {
                    self.q_min[j]
                } else if q > self.q_max[j] {
                    self.q_max[j]
                } else {
                    q
                }
            })
        })
    }

    fn run<const I: usize, const O: usize, const N: usize>(
        &self,
        layers: &[Layer],
        input: &[[f32; I]; N],
    ) -> [[f32; O]; N] {
        let mut from = [[0.0; WIDTH_MAX]; N];
        for n in 0..N {
            from[n][..I].copy_from_slice(&input[n]);
        }
        let out = self.level.dispatch(Run { arena: &self.arena, layers, from });
        std::array::from_fn(|n| std::array::from_fn(|i| out[n][i]))
    }
}

/// Activations of `N` arms, structure of arrays.
type Rows<const N: usize> = [[f32; WIDTH_MAX]; N];

/// One pass through all layers, to be compiled once for each level of the processor.
struct Run<'a, const N: usize> {
    arena: &'a [Line],
    layers: &'a [Layer],
    from: Rows<N>,
}

impl<const N: usize> WithSimd for Run<'_, N> {
    type Output = Rows<N>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Rows<N> {
        let mut from = self.from;
        let mut to = [[0.0; WIDTH_MAX]; N];
        for layer in self.layers {
            layer_forward(simd, &self.arena[layer.at..], layer, &from, &mut to);
            std::mem::swap(&mut from, &mut to);
        }
        from
    }
}

/// Lines of the panel that begins at `line` of a layer of `lines`: 8 accumulators, fewer at its end.
fn panel_lines(lines: usize, line: usize) -> usize {
    match lines - line {
        0..2 => 1,
        2..4 => 2,
        4..8 => 4,
        _ => 8,
    }
}

fn pack(layers: &[Dense], inputs: usize, outputs: usize, arena: &mut Vec<Line>) -> Vec<Layer> {
    let mut width = inputs;
    let mut packed = Vec::new();
    for (i, dense) in layers.iter().enumerate() {
        assert!(dense.inputs == width && dense.outputs <= WIDTH_MAX, "layers fit together");
        assert!(
            dense.weight.len() == dense.inputs * dense.outputs && dense.bias.len() == dense.outputs,
            "layer is full"
        );
        width = dense.outputs;
        let lines = dense.outputs.div_ceil(LINE);
        let at = arena.len();
        let line_of = |line: usize, value: &dyn Fn(usize) -> f32| {
            Line(std::array::from_fn(|l| if line * LINE + l < dense.outputs { value(line * LINE + l) } else { 0.0 }))
        };
        arena.extend((0..lines).map(|line| line_of(line, &|o| dense.bias[o])));
        let mut line = 0;
        while line < lines {
            let panel = panel_lines(lines, line);
            for k in 0..dense.inputs {
                arena.extend((line..line + panel).map(|l| line_of(l, &|o| dense.weight[o * dense.inputs + k])));
            }
            line += panel;
        }
        packed.push(Layer { inputs: dense.inputs, lines, at, hidden: i + 1 < layers.len() });
    }
    assert!(width == outputs, "layers fit together");
    packed
}

/// to = act(W from + b): panel by panel, each as many accumulators as the level has registers for.
#[inline(always)]
fn layer_forward<S: Simd, const N: usize>(simd: S, arena: &[Line], layer: &Layer, from: &Rows<N>, to: &mut Rows<N>) {
    let (bias, mut weights) = arena.split_at(layer.lines);
    let per_line = LINE / S::F32_LANES;
    let mut line = 0;
    while line < layer.lines {
        let panel = panel_lines(layer.lines, line);
        let (here, rest) = weights.split_at(panel * layer.inputs);
        let here = S::as_simd_f32s(bytemuck::cast_slice(here)).0;
        let bias = S::as_simd_f32s(bytemuck::cast_slice(&bias[line..line + panel])).0;
        let stride = panel * per_line;
        let mut column = 0;
        while column < stride {
            let at = line * LINE + column * S::F32_LANES;
            let block = Block { weights: here, bias, stride, column, inputs: layer.inputs, at };
            column += match stride - column {
                8.. if S::F32_LANES == LINE => block.forward::<S, 8, N>(simd, from, to),
                4.. => block.forward::<S, 4, N>(simd, from, to),
                2.. => block.forward::<S, 2, N>(simd, from, to),
                _ => block.forward::<S, 1, N>(simd, from, to),
            };
        }
        weights = rest;
        line += panel;
    }
    if layer.hidden {
        for row in to {
            for x in &mut row[..layer.lines * LINE] {
                *x = silu(*x);
            }
        }
    }
}

/// Some columns of a panel: what is summed in registers at once.
struct Block<'a, V> {
    weights: &'a [V],
    bias: &'a [V],
    stride: usize,
    column: usize,
    inputs: usize,
    at: usize,
}

impl<V: Copy + Pod> Block<'_, V> {
    /// Sums `G` vectors of outputs for `N` arms over all inputs; returns `G`. A product is rounded before it is added,
    /// on every level, so that all levels give the same bits.
    #[inline(always)]
    fn forward<S: Simd<f32s = V>, const G: usize, const N: usize>(
        &self,
        simd: S,
        from: &Rows<N>,
        to: &mut Rows<N>,
    ) -> usize {
        let mut sum = [[simd.splat_f32s(0.0); G]; N];
        for row in &mut sum {
            row.copy_from_slice(&self.bias[self.column..self.column + G]);
        }
        let rows = self.weights.chunks_exact(self.stride).take(self.inputs);
        for (k, row) in rows.enumerate() {
            let row = &row[self.column..self.column + G];
            for n in 0..N {
                let x = simd.splat_f32s(from[n][k]);
                for g in 0..G {
                    sum[n][g] = simd.add_f32s(sum[n][g], simd.mul_f32s(x, row[g]));
                }
            }
        }
        for n in 0..N {
            let out: &mut [f32] = &mut to[n][self.at..self.at + G * S::F32_LANES];
            S::as_mut_simd_f32s(out).0.copy_from_slice(&sum[n]);
        }
        G
    }
}

/// x / (1 + exp(-x)).
#[inline(always)]
fn silu(x: f32) -> f32 {
    x / (1.0 + exp(-x))
}

/// 1 - 2 / (1 + exp(2 x)); absolute error below 2e-7, which is what a joint position needs.
#[inline(always)]
fn tanh(x: f32) -> f32 {
    1.0 - 2.0 / (1.0 + exp(2.0 * x))
}

/// exp without a branch, so that it vectorises: x = n ln 2 + r, 2^n by the exponent bits, exp(r) by the polynomial of
/// Cephes `expf` (relative error 2e-7). Saturates at exp(+-87), passes NaN.
#[inline(always)]
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
    use nalgebra::Vector3;

    fn dense(inputs: usize, outputs: usize) -> Dense {
        let value = |i: usize| (i as f32 * 12.9898).sin();
        let scale = 2.0 / (inputs as f32).sqrt();
        let weight = (0..inputs * outputs).map(|i| value(i) * scale).collect();
        Dense { inputs, outputs, weight, bias: (0..outputs).map(value).collect() }
    }

    #[test]
    fn every_level_of_the_processor_gives_the_same_bits() {
        let axes = [Vector3::x(), Vector3::y(), Vector3::x(), Vector3::y(), Vector3::x()];
        let arm = ArmModel::new(axes, [0.0; 5], [-1.0; 5], [2.0; 5]);
        let layers = Layers {
            human: vec![dense(12, 100), dense(100, 128), dense(128, 8)],
            robot: vec![dense(5, 8)],
            decoder: vec![dense(8, 36), dense(36, 5)],
        };
        let best = Network::new(&layers, &arm);
        let mut levels = vec![pulp::Arch::Scalar];
        #[cfg(target_arch = "x86_64")]
        levels.extend(pulp::x86::V3::try_new().map(pulp::Arch::V3));
        for level in levels {
            let other = Network { level, ..best.clone() };
            for i in 0..100 {
                let input = [[i as f32 * 0.02 - 1.0; FEATURES], [1.0 - i as f32 * 0.03; FEATURES]];
                let latents = best.encode_human(&input);
                assert_eq!(latents, other.encode_human(&input), "{level:?}");
                assert_eq!(best.decode(&latents), other.decode(&latents), "{level:?}");
            }
        }
    }

    #[test]
    fn the_exponential_is_exact_to_three_units_in_the_last_place() {
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
