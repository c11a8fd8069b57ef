//! Dense products and wide vectors. This is the only file of the trainer that needs `unsafe`: the pointer interface of
//! the `gemm` crate is wrapped here behind slices and checks. `tests/gradients.rs` compares the products with candle's.
#![allow(unsafe_code)]

use gemm::Parallelism;
use pulp::Arch;

/// A row-major matrix over a slice, optionally read transposed.
#[derive(Clone, Copy, Debug)]
pub struct Mat<'a> {
    data: &'a [f32],
    rows: usize,
    cols: usize,
    /// Distance between two rows, and between two columns, in elements.
    steps: [isize; 2],
}

impl<'a> Mat<'a> {
    /// The `rows` x `cols` matrix stored row by row at the start of `data`. Panics if `data` is shorter.
    pub fn new(data: &'a [f32], rows: usize, cols: usize) -> Self {
        assert!(data.len() >= rows * cols, "matrix {rows} x {cols} over {} values", data.len());
        Self { data, rows, cols, steps: [cols as isize, 1] }
    }

    /// Returns the same storage, read as its transpose.
    pub fn t(self) -> Self {
        let [row, col] = self.steps;
        Self { rows: self.cols, cols: self.rows, steps: [col, row], ..self }
    }
}

/// Computes `dst = a b`, or `dst += a b` if `accumulate` is true. `dst` is row-major and exactly rows(a) x
/// cols(b). Panics if the shapes do not agree.
pub fn multiply(dst: &mut [f32], a: Mat<'_>, b: Mat<'_>, accumulate: bool) {
    let (m, inner, n) = (a.rows, a.cols, b.cols);
    assert_eq!(inner, b.rows, "inner dimensions of a product");
    assert_eq!(dst.len(), m * n, "destination of a {m} x {n} product");
    if m == 0 || n == 0 {
        return;
    }
    let ([a_rs, a_cs], [b_rs, b_cs]) = (a.steps, b.steps);
    // SAFETY: `gemm` reads a[i * rs + j * cs] for i < m, j < inner. `Mat::new` checked that the storage holds rows *
    // cols values. With these steps the largest index is rows * cols - 1 in either reading. The same holds for b. It
    // writes dst[i * n + j] for i < m, j < n, and the length was asserted to be m * n. `dst` is an exclusive borrow, so
    // it overlaps neither input. No parallelism is requested, so no pointer leaves this thread.
    unsafe {
        gemm::gemm(
            m,
            n,
            inner,
            dst.as_mut_ptr(),
            1,
            n as isize,
            accumulate,
            a.data.as_ptr(),
            a_cs,
            a_rs,
            b.data.as_ptr(),
            b_cs,
            b_rs,
            1.0_f32,
            1.0_f32,
            false,
            false,
            false,
            Parallelism::None,
        );
    }
}

/// Runs `work` compiled for the widest vectors of this machine. Functions that it calls must be
/// `#[inline(always)]`, or they stay at the baseline instruction set.
#[inline]
pub fn widest<R>(work: impl FnOnce() -> R) -> R {
    Arch::new().dispatch(work)
}
