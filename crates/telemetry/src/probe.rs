//! The loop's end of the ring.

use crate::collector::Collector;
use crate::counter::{Counter, Counters};
use crate::event::Event;
use crate::metric::Metric;
use messages::Stamp;
use rtrb::{Producer, RingBuffer};
use std::sync::Arc;

/// Entries that the ring holds. A loop puts in at most five per tick, 7,500 per second. So the collector may stop
/// for two seconds before an entry is lost.
pub const RING_CAPACITY: usize = 16_384;

/// An entry of the ring.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Entry {
    /// A duration and when it ended.
    Sample { metric: Metric, at: Stamp, ns: u64 },
    /// Number of indices of the grid that were skipped at once.
    Missed(u64),
    /// An event for the log.
    Event(Event),
}

/// The loop's end of the ring: wait-free, without allocation, lock or system call.
#[derive(Debug)]
pub struct Probe {
    ring: Producer<Entry>,
    counters: Arc<Counters>,
}

/// Creates a probe for the loop of `process`, and the collector for another thread.
pub fn channel(process: &'static str) -> (Probe, Collector) {
    let (producer, consumer) = RingBuffer::new(RING_CAPACITY);
    let counters = Arc::new(Counters::default());
    (Probe { ring: producer, counters: Arc::clone(&counters) }, Collector::new(process, consumer, counters))
}

impl Probe {
    /// Records a duration of `ns` that ended at `at`.
    pub fn record_ns(&mut self, metric: Metric, at: Stamp, ns: u64) {
        self.push(Entry::Sample { metric, at, ns });
    }

    /// Records the time from `from` to `to`. It is zero if `to` is earlier.
    pub fn record(&mut self, metric: Metric, from: Stamp, to: Stamp) {
        self.record_ns(metric, to, to.since(from));
    }

    /// Records that `count` indices of the grid were skipped at once. Misses come in bursts: ten seconds of them
    /// give one log line.
    pub fn missed(&mut self, count: u64) {
        self.counters.add(Counter::MissedDeadlines, count);
        self.push(Entry::Missed(count));
    }

    /// Records an event for the log.
    pub fn event(&mut self, event: Event) {
        self.push(Entry::Event(event));
    }

    /// Returns the counters of this process.
    pub fn counters(&self) -> &Counters {
        &self.counters
    }

    fn push(&mut self, entry: Entry) {
        if self.ring.push(entry).is_err() {
            self.counters.add(Counter::RingDropped, 1);
        }
    }
}
