//! A multilayer perceptron with SiLU between its layers: forward and analytic backward over whole batches.
//!
//! h_0 = x, h_l = silu(W_l h_{l-1} + b_l), output = W_L h_{L-1} + b_L. Weights are `[out, in]`, row by row,
//! followed by the biases. All layers are in one slice, so that the optimiser sees one vector.

use crate::gemm::{Mat, multiply, widest};
use perceptron::Dense;
use rand::RngExt;
use rand_pcg::Pcg64;
use std::ops::Range;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shape {
    pub input: usize,
    /// Number of hidden layers, at least 1.
    pub hidden_layers: usize,
    /// Units of each hidden layer.
    pub hidden_width: usize,
    pub output: usize,
}

/// Position of one layer in the parameter slice.
#[derive(Clone, Debug)]
pub struct Layer {
    pub input: usize,
    pub output: usize,
    /// `[output, input]` weights, row by row.
    pub weight: Range<usize>,
    /// `output` biases.
    pub bias: Range<usize>,
}

#[derive(Clone, Debug)]
pub struct Mlp {
    pub shape: Shape,
    pub layers: Vec<Layer>,
}

/// Results of a forward pass that the backward pass needs, for a fixed number of rows.
#[derive(Clone, Debug)]
pub struct Trace {
    rows: usize,
    /// `[rows, input]`, filled by the caller before `forward`.
    pub input: Vec<f32>,
    /// `[rows, output]`, the result.
    pub output: Vec<f32>,
    /// Per hidden layer, `[rows, width]`: silu(a).
    hidden: Vec<Vec<f32>>,
    /// Per hidden layer, `[rows, width]`: silu'(a).
    slope: Vec<Vec<f32>>,
    /// Two buffers for the gradient that travels back.
    delta: [Vec<f32>; 2],
}

impl Mlp {
    /// Lays the perceptron out in the parameter slice from `start` on.
    pub fn new(shape: Shape, start: usize) -> Self {
        assert!(shape.hidden_layers >= 1, "a perceptron has at least one hidden layer");
        let mut layers = Vec::new();
        let mut at = start;
        let mut input = shape.input;
        for index in 0..=shape.hidden_layers {
            let output = if index == shape.hidden_layers { shape.output } else { shape.hidden_width };
            let weight = at..at + input * output;
            let bias = weight.end..weight.end + output;
            at = bias.end;
            layers.push(Layer { input, output, weight, bias });
            input = output;
        }
        Self { shape, layers }
    }

    /// Returns the index after its last parameter.
    pub fn end(&self) -> usize {
        self.layers.last().map_or(0, |layer| layer.bias.end)
    }

    /// Draws random weights. They are uniform with variance 2/inputs before a SiLU (He et al. 2015), and 1/inputs before
    /// the output. Biases stay as they are.
    pub fn draw(&self, parameters: &mut [f32], rng: &mut Pcg64) {
        for (index, layer) in self.layers.iter().enumerate() {
            let gain = if index == self.shape.hidden_layers { 1.0 } else { 2.0 };
            let bound = (3.0 * gain / layer.input as f32).sqrt();
            parameters[layer.weight.clone()].fill_with(|| rng.random_range(-bound..bound));
        }
    }

    pub fn dense(&self, parameters: &[f32]) -> Vec<Dense> {
        let layers = self.layers.iter().map(|layer| Dense {
            inputs: layer.input,
            outputs: layer.output,
            weight: parameters[layer.weight.clone()].to_vec(),
            bias: parameters[layer.bias.clone()].to_vec(),
        });
        layers.collect()
    }

    pub fn trace(&self, rows: usize) -> Trace {
        let width = self.shape.hidden_width;
        let hidden = vec![vec![0.0; rows * width]; self.shape.hidden_layers];
        Trace {
            rows,
            input: vec![0.0; rows * self.shape.input],
            output: vec![0.0; rows * self.shape.output],
            slope: hidden.clone(),
            hidden,
            delta: [vec![0.0; rows * width], vec![0.0; rows * width]],
        }
    }

    /// Computes `trace.output` from `trace.input`.
    pub fn forward(&self, parameters: &[f32], trace: &mut Trace) {
        let rows = trace.rows;
        for (index, layer) in self.layers.iter().enumerate() {
            let weight = Mat::new(&parameters[layer.weight.clone()], layer.output, layer.input);
            let bias = &parameters[layer.bias.clone()];
            let (before, from) = trace.hidden.split_at_mut(index);
            let input = before.last().map_or(trace.input.as_slice(), Vec::as_slice);
            let input = Mat::new(input, rows, layer.input);
            match from.first_mut() {
                Some(hidden) => {
                    multiply(hidden, input, weight.t(), false);
                    widest(|| silu_with_slope(hidden, &mut trace.slope[index], bias));
                }
                None => {
                    multiply(&mut trace.output, input, weight.t(), false);
                    for row in trace.output.chunks_exact_mut(layer.output) {
                        row.iter_mut().zip(bias).for_each(|(y, b)| *y += b);
                    }
                }
            }
        }
    }

    /// Adds dL/dparameters to `gradient` and, on request, writes dL/dinput. `grad_output` is dL/doutput,
    /// `[rows, output]`. `gradient` has the layout of `parameters`.
    pub fn backward(
        &self,
        parameters: &[f32],
        trace: &mut Trace,
        grad_output: &[f32],
        gradient: &mut [f32],
        grad_input: Option<&mut [f32]>,
    ) {
        let rows = trace.rows;
        let Trace { input, hidden, slope, delta: [first, second], .. } = trace;
        let (mut delta, mut next): (&mut [f32], &mut [f32]) = (first, second);
        for (index, layer) in self.layers.iter().enumerate().skip(1).rev() {
            let out: &[f32] = if index == self.shape.hidden_layers { grad_output } else { delta };
            let below = &hidden[index - 1];
            accumulate_layer(layer, out, below, rows, gradient);
            let weight = Mat::new(&parameters[layer.weight.clone()], layer.output, layer.input);
            multiply(next, Mat::new(out, rows, layer.output), weight, false);
            widest(|| times(next, &slope[index - 1]));
            std::mem::swap(&mut delta, &mut next);
        }
        let layer = &self.layers[0];
        accumulate_layer(layer, delta, input, rows, gradient);
        if let Some(grad_input) = grad_input {
            let weight = Mat::new(&parameters[layer.weight.clone()], layer.output, layer.input);
            multiply(grad_input, Mat::new(delta, rows, layer.output), weight, false);
        }
    }
}

/// Computes dW += delta^T h and db += column sums of delta.
fn accumulate_layer(layer: &Layer, delta: &[f32], below: &[f32], rows: usize, gradient: &mut [f32]) {
    let delta_t = Mat::new(delta, rows, layer.output).t();
    multiply(&mut gradient[layer.weight.clone()], delta_t, Mat::new(below, rows, layer.input), true);
    let bias = &mut gradient[layer.bias.clone()];
    widest(|| add_rows(bias, delta));
}

#[inline(always)]
fn add_rows(sum: &mut [f32], rows: &[f32]) {
    for row in rows.chunks_exact(sum.len()) {
        sum.iter_mut().zip(row).for_each(|(s, v)| *s += v);
    }
}

#[inline(always)]
fn times(values: &mut [f32], factors: &[f32]) {
    values.iter_mut().zip(factors).for_each(|(v, f)| *v *= f);
}

/// Computes in place: a = value + bias, value = a s(a), slope = s (1 + a (1 - s)), with s the logistic function.
#[inline(always)]
fn silu_with_slope(values: &mut [f32], slopes: &mut [f32], bias: &[f32]) {
    let width = bias.len();
    for (row, slope_row) in values.chunks_exact_mut(width).zip(slopes.chunks_exact_mut(width)) {
        for ((value, slope), b) in row.iter_mut().zip(slope_row).zip(bias) {
            let a = *value + b;
            let s = 1.0 / (1.0 + exp(-a));
            *value = a * s;
            *slope = s * (1.0 + a * (1.0 - s));
        }
    }
}

/// Returns e^x to 2 ulp, without a branch or a call, so that it vectorises. It uses x = n ln 2 + r, a polynomial in r
/// (Cephes `expf` coefficients), and 2^n by its bits. The argument is clamped to +-87, where the range of f32 ends.
#[inline(always)]
fn exp(x: f32) -> f32 {
    // 1.5 * 2^23: adding it rounds to an integer in the low bits of the mantissa.
    const ROUND: f32 = 12_582_912.0;
    // ln 2 in two parts (Cephes). So n * LN2_HIGH is exact.
    const LN2_HIGH: f32 = 0.693_359_4;
    const LN2_LOW: f32 = -2.121_944_4e-4;
    let x = x.clamp(-87.0, 87.0);
    let shifted = x * std::f32::consts::LOG2_E + ROUND;
    let n = shifted - ROUND;
    let r = x - n * LN2_HIGH - n * LN2_LOW;
    let mut p = 1.987_569_1e-4;
    p = p * r + 1.398_199_9e-3;
    p = p * r + 8.333_452e-3;
    p = p * r + 4.166_579_6e-2;
    p = p * r + 1.666_666_5e-1;
    p = p * r + 0.5;
    let power = f32::from_bits(shifted.to_bits().wrapping_sub(ROUND.to_bits()).wrapping_add(127) << 23);
    (p * r * r + r + 1.0) * power
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exponential_is_accurate_over_its_range() {
        for i in -8700..=8700 {
            let x = i as f32 * 0.01;
            let want = f64::from(x).exp();
            assert!((f64::from(exp(x)) - want).abs() <= 4e-7 * want, "exp({x})");
        }
        assert!(exp(-1e4) > 0.0 && exp(1e4).is_finite());
    }
}
