//! Numbers that a loop stores and others read. `tests/models` looks at every interleaving of it, with atomics of its own.

use super::atomic::{AtomicU64, Ordering};

/// A number of one process.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Counter {
    /// Rounds of the loop; the watchdog looks at it.
    Ticks,
    /// Indices of the grid that were skipped.
    MissedDeadlines,
    /// Messages that the bus did not take.
    PublishFailures,
    /// Times the process found that it had stood still for longer than a command stays valid.
    Gaps,
    /// Allocations of the loop's thread since READY, without the transport's.
    Allocations,
    /// Allocations of the loop's thread inside the transport since READY.
    TransportAllocations,
    /// Samples and events that found the ring full.
    RingDropped,
    /// `Mode` in force, as its number (control).
    Mode,
    /// Active faults, as bits of `Faults` (control).
    Faults,
    /// Latched faults, as bits of `Faults` (control).
    Latched,
    /// Frames of clients without authority (ingest).
    WithoutAuthority,
    /// Frames passed over because their publisher sent more than the rate (ingest).
    OverQuota,
    /// Connections turned away at a door.
    Refused,
    /// Places of single joints that were held for a frame because they were outliers (ingest).
    Outliers,
}

impl Counter {
    /// All of them; the index of each is its place.
    pub const ALL: [Self; 14] = [
        Self::Ticks,
        Self::MissedDeadlines,
        Self::PublishFailures,
        Self::Gaps,
        Self::Allocations,
        Self::TransportAllocations,
        Self::RingDropped,
        Self::Mode,
        Self::Faults,
        Self::Latched,
        Self::WithoutAuthority,
        Self::OverQuota,
        Self::Refused,
        Self::Outliers,
    ];
}

/// The numbers of one process. Each has one writer, its loop.
#[derive(Debug, Default)]
pub struct Counters {
    values: [AtomicU64; Counter::ALL.len()],
}

impl Counters {
    /// The newest value.
    pub fn get(&self, counter: Counter) -> u64 {
        self.values[counter as usize].load(Ordering::Relaxed)
    }

    /// Stores a value.
    pub fn set(&self, counter: Counter, value: u64) {
        self.values[counter as usize].store(value, Ordering::Relaxed);
    }

    /// Adds to a value. There is one writer, so reading and storing apart loses nothing.
    pub fn add(&self, counter: Counter, more: u64) {
        self.set(counter, self.get(counter).wrapping_add(more));
    }
}
