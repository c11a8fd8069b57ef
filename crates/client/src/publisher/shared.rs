//! Values that the publishing thread and its owner share. `tests/models` checks every interleaving, with atomics
//! of its own.

use super::atomic::{AtomicBool, AtomicU64, Ordering};

/// The owner writes levels, and the thread writes counts. The counts have one writer.
#[derive(Debug, Default)]
pub(super) struct Shared {
    engaged: AtomicBool,
    stop: AtomicBool,
    finished: AtomicBool,
    published: AtomicU64,
    failures: AtomicU64,
}

impl Shared {
    pub(super) fn set_engaged(&self, engaged: bool) {
        self.engaged.store(engaged, Ordering::Relaxed);
    }

    pub(super) fn engaged(&self) -> bool {
        self.engaged.load(Ordering::Relaxed)
    }

    pub(super) fn stop(&self) {
        self.stop.store(true, Ordering::Relaxed);
    }

    pub(super) fn stopped(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }

    /// Notes that a frame was published or not taken. A reader that sees `finished` also sees the final counts.
    pub(super) fn publish(&self, published: u64, failed: bool, finished: bool) {
        self.failures.fetch_add(u64::from(failed), Ordering::Relaxed);
        self.published.store(published, Ordering::Relaxed);
        self.finished.store(finished, Ordering::Release);
    }

    pub(super) fn finished(&self) -> bool {
        self.finished.load(Ordering::Acquire)
    }

    pub(super) fn published(&self) -> u64 {
        self.published.load(Ordering::Relaxed)
    }

    pub(super) fn failures(&self) -> u64 {
        self.failures.load(Ordering::Relaxed)
    }
}
