//! One multilayer perceptron, packed once and then run without allocation.

use bytemuck::{Pod, Zeroable};
use pulp::{Arch, Scalar128b, Simd};

use crate::kernel::Pass;

/// Widest layer that the fixed buffers hold, inputs included: the 558 of the prediction, in whole cache lines.
pub const WIDTH_MAX: usize = 560;
/// Widest layer that the smaller buffers hold: the paper's.
const WIDTH_USUAL: usize = 128;

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

/// Vector instructions of the processor. All levels with fused multiply-add, which are all but the portable one,
/// give the same bits. The portable one differs by rounding, below 1e-5 of the largest output.
#[derive(Clone, Copy, Debug)]
pub struct Level(Kind);

#[derive(Clone, Copy, Debug)]
enum Kind {
    Portable,
    Detected(Arch),
}

impl Level {
    /// Returns the widest level of this processor.
    pub fn best() -> Self {
        let arch = Arch::new();
        Self(if matches!(arch, Arch::Scalar) { Kind::Portable } else { Kind::Detected(arch) })
    }

    /// Returns the level for every processor of the target architecture. Its multiply-adds are not fused.
    pub fn portable() -> Self {
        Self(Kind::Portable)
    }

    /// Returns all levels of this processor, widest first.
    pub fn available() -> Vec<Self> {
        #[allow(unused_mut, reason = "other architectures have one level beside the portable one")]
        let mut found = vec![Self::best()];
        #[cfg(target_arch = "x86_64")]
        if let (Kind::Detected(Arch::V4(_)), Some(v3)) = (found[0].0, pulp::x86::V3::try_new()) {
            found.push(Self(Kind::Detected(Arch::V3(v3))));
        }
        if !matches!(found[0].0, Kind::Portable) {
            found.push(Self::portable());
        }
        found
    }

    /// Common name.
    pub fn name(self) -> &'static str {
        match self.0 {
            #[cfg(target_arch = "x86_64")]
            Kind::Detected(Arch::V4(_)) => "AVX-512",
            #[cfg(target_arch = "x86_64")]
            Kind::Detected(Arch::V3(_)) => "AVX2",
            #[cfg(target_arch = "aarch64")]
            Kind::Detected(Arch::Neon(_)) => "NEON",
            _ => "portable",
        }
    }

    /// Numbers in a vector.
    fn lanes(self) -> usize {
        match self.name() {
            "AVX-512" => 16,
            "AVX2" => 8,
            _ => 4,
        }
    }
}

/// 16 numbers on one cache line.
#[repr(C, align(64))]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(crate) struct Line([f32; LINE]);

/// Numbers in a cache line.
pub(crate) const LINE: usize = 16;

/// A layer inside the arena: bias lines, then panels, each `[rows][lines of the panel]`. A row holds the weights of one
/// input.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Layer {
    pub(crate) rows: usize,
    pub(crate) lines: usize,
    pub(crate) at: usize,
    pub(crate) hidden: bool,
}

/// A multilayer perceptron with SiLU after every layer except the last: y = W_n silu(... silu(W_1 x + b_1) ...) +
/// b_n. Weights lie on cache lines in the order of reading.
#[derive(Clone, Debug)]
pub struct Perceptron {
    level: Level,
    arena: Vec<Line>,
    layers: Vec<Layer>,
    inputs: usize,
    outputs: usize,
    widest: usize,
}

impl Perceptron {
    /// Packs `layers`, from input to output, for the widest vectors of this processor.
    ///
    /// # Panics
    /// Panics on a bug of the caller: no layer, layers that do not fit together or are not full, layers without
    /// input or output, or layers wider than `WIDTH_MAX`.
    pub fn new(layers: &[Dense]) -> Self {
        Self::at_level(layers, Level::best())
    }

    /// As `new`, for the given vectors.
    ///
    /// # Panics
    /// As `new`.
    pub fn at_level(layers: &[Dense], level: Level) -> Self {
        let (Some(first), Some(last)) = (layers.first(), layers.last()) else { panic!("a network has a layer") };
        let mut packed = Self {
            level,
            arena: Vec::with_capacity(
                layers.iter().map(|layer| layer.outputs.div_ceil(LINE) * (1 + layer.inputs)).sum(),
            ),
            layers: Vec::new(),
            inputs: first.inputs,
            outputs: last.outputs,
            widest: first.inputs,
        };
        let mut width = first.inputs;
        for (i, dense) in layers.iter().enumerate() {
            assert!(dense.inputs == width, "layers fit together");
            assert!((1..=WIDTH_MAX).contains(&dense.inputs), "a layer has 1 to {WIDTH_MAX} inputs");
            assert!((1..=WIDTH_MAX).contains(&dense.outputs), "a layer has 1 to {WIDTH_MAX} outputs");
            assert!(dense.weight.len() == dense.inputs * dense.outputs, "a layer is full");
            assert!(dense.bias.len() == dense.outputs, "a layer is full");
            width = dense.outputs;
            packed.widest = packed.widest.max(width);
            packed.push(dense, i + 1 < layers.len());
        }
        packed
    }

    /// Computes the outputs for `N` inputs. It reads the weights once for all of them. An input alone gives the
    /// same bits as among others. The result is not finite if an input or the weights are not. It is all NaN if
    /// `I` and `O` are not the network's sizes. Never allocates or panics.
    pub fn forward<const I: usize, const O: usize, const N: usize>(&self, input: &[[f32; I]; N]) -> [[f32; O]; N] {
        let mut output = [[f32::NAN; O]; N];
        if I != self.inputs || O != self.outputs {
            return output;
        }
        let from = input.each_ref().map(|row| row.as_slice());
        let to = output.each_mut().map(|row| row.as_mut_slice());
        if self.widest <= WIDTH_USUAL {
            self.run::<N, WIDTH_USUAL>(from, to);
        } else {
            self.run::<N, WIDTH_MAX>(from, to);
        }
        output
    }

    /// Number of inputs.
    pub fn inputs(&self) -> usize {
        self.inputs
    }

    /// Number of outputs.
    pub fn outputs(&self) -> usize {
        self.outputs
    }

    #[inline]
    fn run<const N: usize, const W: usize>(&self, from: [&[f32]; N], to: [&mut [f32]; N]) {
        let (arena, layers) = (&*self.arena, &*self.layers);
        match self.level.0 {
            Kind::Portable => Scalar128b.vectorize(Pass::<N, W, false> { arena, layers, from, to }),
            Kind::Detected(arch) => arch.dispatch(Pass::<N, W, true> { arena, layers, from, to }),
        }
    }

    fn push(&mut self, dense: &Dense, hidden: bool) {
        let (rows, lines) = (dense.inputs, dense.outputs.div_ceil(LINE));
        let weight = |o: usize, i: usize| if o < dense.outputs { dense.weight[o * dense.inputs + i] } else { 0.0 };
        self.layers.push(Layer { rows, lines, at: self.arena.len(), hidden });
        self.arena.extend(
            (0..lines).map(|line| {
                Line(std::array::from_fn(|l| dense.bias.get(line * LINE + l).copied().unwrap_or_default()))
            }),
        );
        let mut line = 0;
        while line < lines {
            let panel = panel_lines(self.level.lanes(), lines - line);
            for row in 0..rows {
                self.arena.extend(
                    (line..line + panel).map(|line| Line(std::array::from_fn(|l| weight(line * LINE + l, row)))),
                );
            }
            line += panel;
        }
    }
}

/// Computes every layer as a sum of products. x / (1 + e^-x) follows every layer except the last.
pub fn plain(layers: &[Dense], input: &[f64]) -> Vec<f64> {
    let mut x = input.to_vec();
    for (i, layer) in layers.iter().enumerate() {
        let rows = layer.weight.chunks_exact(layer.inputs).zip(&layer.bias);
        let sum = |(row, bias): (&[f32], &f32)| {
            f64::from(*bias) + row.iter().zip(&x).map(|(w, x)| f64::from(*w) * x).sum::<f64>()
        };
        let hidden = i + 1 < layers.len();
        x = rows.map(sum).map(|y| if hidden { y / (1.0 + (-y).exp()) } else { y }).collect();
    }
    x
}

/// Number of lines in the next panel of a layer with `remain` lines left, for vectors of `lanes` numbers. A panel has
/// at most eight vectors of 16 numbers, or four shorter ones. The processor has half as many registers for those.
#[inline(always)]
pub(crate) fn panel_lines(lanes: usize, remain: usize) -> usize {
    match (lanes, remain) {
        (16, 8..) => 8,
        (16, 4..) => 4,
        (8 | 16, 2..) => 2,
        _ => 1,
    }
}
