//! A sorted list of the keys with the least distance left. A program has rows for these.

use crate::qp::ROWS_MAX;

/// At most [`ROWS_MAX`] keys, sorted by the distance that each has left, m. The first `len` are valid.
#[derive(Clone, Debug)]
pub(crate) struct Nearest<K> {
    pub(crate) left: [f64; ROWS_MAX],
    pub(crate) keys: [K; ROWS_MAX],
    pub(crate) len: usize,
}

impl<K: Copy + Default> Nearest<K> {
    pub(crate) fn new() -> Self {
        Self { left: [0.0; ROWS_MAX], keys: [K::default(); ROWS_MAX], len: 0 }
    }

    pub(crate) fn clear(&mut self) {
        self.len = 0;
    }

    /// Inserts `key` in its place. If the list is full, the key with the most distance left is dropped.
    pub(crate) fn insert(&mut self, left: f64, key: K) {
        let mut at = self.len;
        if at == ROWS_MAX {
            if left >= self.left[at - 1] {
                return;
            }
            at -= 1;
        } else {
            self.len += 1;
        }
        while at > 0 && self.left[at - 1] > left {
            (self.left[at], self.keys[at]) = (self.left[at - 1], self.keys[at - 1]);
            at -= 1;
        }
        (self.left[at], self.keys[at]) = (left, key);
    }

    /// Drops the keys for which `keep` returns false.
    pub(crate) fn retain(&mut self, keep: impl Fn(f64, K) -> bool) {
        let mut kept = 0;
        for k in 0..self.len {
            if keep(self.left[k], self.keys[k]) {
                (self.left[kept], self.keys[kept]) = (self.left[k], self.keys[k]);
                kept += 1;
            }
        }
        self.len = kept;
    }
}
