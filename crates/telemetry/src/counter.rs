//! Counters that a loop stores and other threads read. `tests/models` checks every interleaving, with atomics of
//! its own.

use super::atomic::{AtomicU64, Ordering};

/// A counter of one process.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Counter {
    /// Rounds of the loop. The watchdog reads it.
    Ticks,
    /// Indices of the grid that were skipped.
    MissedDeadlines,
    /// Messages that the bus did not take.
    PublishFailures,
    /// Times the process found that it had been stopped for longer than a command stays valid.
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
    /// Frames of clients without the lease (ingest).
    WithoutAuthority,
    /// Frames dropped because their publisher sent more than the rate (ingest).
    OverQuota,
    /// Connections refused at a socket.
    Refused,
    /// Positions of single joints that were held for a frame because they were outliers (ingest).
    Outliers,
}

/// The counters of one process. Each has one writer, the loop of the process.
#[derive(Debug, Default)]
pub struct Counters {
    values: [AtomicU64; Counter::Outliers as usize + 1],
}

impl Counters {
    /// Returns the newest value.
    pub fn get(&self, counter: Counter) -> u64 {
        self.values[counter as usize].load(Ordering::Relaxed)
    }

    /// Stores a value.
    pub fn set(&self, counter: Counter, value: u64) {
        self.values[counter as usize].store(value, Ordering::Relaxed);
    }

    /// Adds to a value. There is one writer, so a separate load and store lose nothing.
    pub fn add(&self, counter: Counter, more: u64) {
        self.set(counter, self.get(counter).wrapping_add(more));
    }
}
