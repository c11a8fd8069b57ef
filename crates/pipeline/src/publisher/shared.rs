//! What the publishing thread and its owner tell each other. `tests/models` looks at every interleaving of it, with atomics
//! of its own.

use super::atomic::{AtomicBool, AtomicU64, Ordering};

/// Levels from the owner, counts from the thread. The counts have one writer.
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

    /// A frame has been published, or was not taken; the counts are seen by whoever sees that it was the last.
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
