//! Counts what is there while it is there.

use std::ops::Deref;
use std::sync::atomic::{AtomicUsize, Ordering};

/// One of them, for as long as it lives.
pub struct Counted<C: Deref<Target = AtomicUsize>>(C);

impl<C: Deref<Target = AtomicUsize>> Counted<C> {
    /// One more in `count`.
    pub fn one_more(count: C) -> Self {
        count.fetch_add(1, Ordering::Relaxed);
        Self(count)
    }
}

impl<C: Deref<Target = AtomicUsize>> Drop for Counted<C> {
    fn drop(&mut self) {
        self.0.fetch_sub(1, Ordering::Relaxed);
    }
}
