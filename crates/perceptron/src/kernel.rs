//! One pass through packed layers, compiled once for each vector level.

use pulp::{Simd, WithSimd};

use crate::network::{LINE, Layer, Line, panel_lines};

/// Number of parallel sums in a layer of one line, so that no addition waits for the previous one.
const CHAINS: usize = 4;

/// Activations of `N` inputs, each in a buffer of `W` numbers.
type Rows<const N: usize, const W: usize> = [[f32; W]; N];

/// Data of one pass. `FUSED`: multiply-adds round once.
pub(crate) struct Pass<'a, const N: usize, const W: usize, const FUSED: bool> {
    pub(crate) arena: &'a [Line],
    pub(crate) layers: &'a [Layer],
    pub(crate) from: [&'a [f32]; N],
    pub(crate) to: [&'a mut [f32]; N],
}

impl<const N: usize, const W: usize, const FUSED: bool> WithSimd for Pass<'_, N, W, FUSED> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let kernel = Kernel::<S, FUSED>(simd);
        let (mut a, mut b) = ([[0.0; W]; N], [[0.0; W]; N]);
        for n in 0..N {
            a[n][..self.from[n].len()].copy_from_slice(self.from[n]);
        }
        let (mut from, mut to) = (&mut a, &mut b);
        for layer in self.layers {
            kernel.layer(&self.arena[layer.at..], layer, from, to);
            std::mem::swap(&mut from, &mut to);
        }
        for (row, to) in from.iter().zip(self.to) {
            to.copy_from_slice(&row[..to.len()]);
        }
    }
}

#[derive(Clone, Copy)]
struct Kernel<S, const FUSED: bool>(S);

impl<S: Simd, const FUSED: bool> Kernel<S, FUSED> {
    /// to = act(W from + b).
    #[inline(always)]
    fn layer<const N: usize, const W: usize>(
        self,
        arena: &[Line],
        layer: &Layer,
        from: &Rows<N, W>,
        to: &mut Rows<N, W>,
    ) {
        let (bias, weights) = arena.split_at(layer.lines);
        let bias = S::as_simd_f32s(bytemuck::cast_slice(bias)).0;
        let mut weights = S::as_simd_f32s(bytemuck::cast_slice(weights)).0;
        let per_line = LINE / S::F32_LANES;
        if layer.lines == 1 {
            return self.narrow(bias, &weights[..layer.rows * per_line], layer, from, to);
        }
        let mut line = 0;
        while line < layer.lines {
            let panel = panel_lines(S::F32_LANES, layer.lines - line);
            let vectors = panel * per_line;
            let at = line * per_line;
            // One input leaves enough registers for two panels.
            let twice = N == 1 && S::F32_LANES < LINE && vectors == 4 && line + 2 * panel <= layer.lines;
            let used = if twice { 2 } else { 1 } * vectors * layer.rows;
            let (here, rest) = weights.split_at(used);
            let place = Place { bias: &bias[at..], at, hidden: layer.hidden };
            match vectors {
                8 => self.block::<8, 1, N, W>([here.as_chunks().0], place, from, to),
                4 if twice => {
                    let (a, b) = here.split_at(used / 2);
                    self.block::<4, 2, N, W>([a.as_chunks().0, b.as_chunks().0], place, from, to);
                }
                4 => self.block::<4, 1, N, W>([here.as_chunks().0], place, from, to),
                2 => self.block::<2, 1, N, W>([here.as_chunks().0], place, from, to),
                _ => self.block::<1, 1, N, W>([here.as_chunks().0], place, from, to),
            }
            weights = rest;
            line += if twice { 2 } else { 1 } * panel;
        }
    }

    /// Sums `M` panels of `G` vectors each, for `N` inputs, in registers over all rows in turn.
    #[inline(always)]
    #[expect(clippy::needless_range_loop, reason = "one index for rows of weights and for inputs")]
    fn block<const G: usize, const M: usize, const N: usize, const W: usize>(
        self,
        panels: [&[[S::f32s; G]]; M],
        place: Place<'_, S::f32s>,
        from: &Rows<N, W>,
        to: &mut Rows<N, W>,
    ) {
        // These bounds remove the checks inside the loop.
        let rows = panels[0].len().min(W);
        let mut sum = [[[self.0.splat_f32s(0.0); G]; M]; N];
        for sum in &mut sum {
            for (m, sum) in sum.iter_mut().enumerate() {
                sum.copy_from_slice(&place.bias[m * G..(m + 1) * G]);
            }
        }
        let mut cut = panels;
        for m in 0..M {
            cut[m] = &panels[m][..rows];
        }
        for r in 0..rows {
            for m in 0..M {
                self.accumulate(&cut[m][r], from, r, &mut sum, m);
            }
        }
        for n in 0..N {
            let out = S::as_mut_simd_f32s(&mut to[n]).0;
            for m in 0..M {
                for g in 0..G {
                    let y = sum[n][m][g];
                    out[place.at + m * G + g] = if place.hidden { self.silu(y) } else { y };
                }
            }
        }
    }

    /// A layer of one line: `CHAINS` sums over every fourth row, then their sum.
    #[inline(always)]
    fn narrow<const N: usize, const W: usize>(
        self,
        bias: &[S::f32s],
        weights: &[S::f32s],
        layer: &Layer,
        from: &Rows<N, W>,
        to: &mut Rows<N, W>,
    ) {
        let place = Place { bias, at: 0, hidden: layer.hidden };
        for n in 0..N {
            match LINE / S::F32_LANES {
                1 => self.chains::<1, W>(weights, place, std::array::from_ref(&from[n]), &mut to[n]),
                2 => self.chains::<2, W>(weights, place, std::array::from_ref(&from[n]), &mut to[n]),
                4 => self.chains::<4, W>(weights, place, std::array::from_ref(&from[n]), &mut to[n]),
                _ => self.chains::<16, W>(weights, place, std::array::from_ref(&from[n]), &mut to[n]),
            }
        }
    }

    #[inline(always)]
    fn chains<const G: usize, const W: usize>(
        self,
        weights: &[S::f32s],
        place: Place<'_, S::f32s>,
        from: &Rows<1, W>,
        to: &mut [f32; W],
    ) {
        let weights: &[[S::f32s; G]] = weights.as_chunks().0;
        let rows = weights.len().min(W);
        let weights = &weights[..rows];
        let mut sum = [[[self.0.splat_f32s(0.0); G]; CHAINS]];
        sum[0][0].copy_from_slice(&place.bias[..G]);
        for r in 0..rows / CHAINS {
            for chain in 0..CHAINS {
                self.accumulate(&weights[CHAINS * r + chain], from, CHAINS * r + chain, &mut sum, chain);
            }
        }
        let whole = rows / CHAINS * CHAINS;
        for (r, words) in weights.iter().enumerate().skip(whole) {
            self.accumulate(words, from, r, &mut sum, r - whole);
        }
        let [sum] = sum;
        let out = S::as_mut_simd_f32s(to).0;
        for g in 0..G {
            let (a, b) = (self.0.add_f32s(sum[0][g], sum[1][g]), self.0.add_f32s(sum[2][g], sum[3][g]));
            let y = self.0.add_f32s(a, b);
            out[place.at + g] = if place.hidden { self.silu(y) } else { y };
        }
    }

    /// Adds the products of row `r` to the sums `m`.
    #[inline(always)]
    fn accumulate<const G: usize, const M: usize, const N: usize, const W: usize>(
        self,
        words: &[S::f32s; G],
        from: &Rows<N, W>,
        r: usize,
        sum: &mut [[[S::f32s; G]; M]; N],
        m: usize,
    ) {
        for g in 0..G {
            for n in 0..N {
                sum[n][m][g] = self.multiply_add(self.0.splat_f32s(from[n][r]), words[g], sum[n][m][g]);
            }
        }
    }

    /// a b + c.
    #[inline(always)]
    fn multiply_add(self, a: S::f32s, b: S::f32s, c: S::f32s) -> S::f32s {
        if FUSED { self.0.mul_add_e_f32s(a, b, c) } else { self.0.add_f32s(self.0.mul_f32s(a, b), c) }
    }

    /// x / (1 + exp(-x)). The relative error is below 2e-6 where multiply-adds are fused, else 1e-5. NaN and
    /// infinities pass.
    #[inline(always)]
    fn silu(self, x: S::f32s) -> S::f32s {
        let simd = self.0;
        let splat = |value: f32| simd.splat_f32s(value);
        // Beyond 87, exp(-x) is 0 or far above 1. The clamp may drop a NaN, because the numerator keeps it.
        let t = simd.max_f32s(splat(-87.0), simd.min_f32s(splat(87.0), x));
        // exp(-t) = 2^n 2^f, n + f = -t log2(e), |f| <= 1/2.
        let scale = splat(-std::f32::consts::LOG2_E);
        let shifted = self.multiply_add(t, scale, splat(ROUND));
        let n = simd.sub_f32s(shifted, splat(ROUND));
        let f = self.multiply_add(t, scale, simd.neg_f32s(n));
        let mut p = splat(EXP2[0]);
        for c in &EXP2[1..] {
            p = self.multiply_add(p, f, splat(*c));
        }
        // The integer in the low bits of `shifted` is added to the exponent.
        let exponent = simd.wrapping_dyn_shl_u32s(simd.transmute_u32s_f32s(shifted), simd.splat_u32s(23));
        let exp = simd.transmute_f32s_u32s(simd.add_u32s(simd.transmute_u32s_f32s(p), exponent));
        simd.div_f32s(x, simd.add_f32s(splat(1.0), exp))
    }
}

/// Position of a block's outputs, in vectors.
#[derive(Clone, Copy)]
struct Place<'a, V> {
    bias: &'a [V],
    at: usize,
    hidden: bool,
}

/// 1.5 * 2^23: adding it rounds to an integer and leaves that integer in the low mantissa bits.
const ROUND: f32 = 12_582_912.0;
/// 2^f on [-1/2, 1/2]: the polynomial of degree 5 through the Chebyshev nodes, highest power first. Relative error
/// 1.6e-7.
const EXP2: [f32; 6] = [1.339_086_3e-3, 9.676_032e-3, 5.550_357e-2, 2.402_210_7e-1, 6.931_472e-1, 1.000_000_1];
