//! The loop's end of the ring.

use crate::collector::Collector;
use crate::counter::{Counter, Counters};
use crate::event::Event;
use crate::metric::Metric;
use messages::Stamp;
use rtrb::{Producer, RingBuffer};
use std::sync::Arc;

/// Entries that the ring holds: a loop puts in at most five a tick, 7,500 a second, so the collector may stand still for
/// two seconds before any is lost.
pub const RING_CAPACITY: usize = 16_384;

/// What lies in the ring.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Entry {
    /// A duration and when it ended.
    Sample { metric: Metric, at: Stamp, ns: u64 },
    /// So many indices of the grid were skipped at once.
    Missed(u64),
    /// Something that is worth a line in the log.
    Event(Event),
}

/// The loop's end: wait-free, without allocation, lock or system call.
#[derive(Debug)]
pub struct Probe {
    ring: Producer<Entry>,
    counters: Arc<Counters>,
}

/// A probe for the loop of `process`, and the collector for another thread.
pub fn channel(process: &'static str) -> (Probe, Collector) {
    let (producer, consumer) = RingBuffer::new(RING_CAPACITY);
    let counters = Arc::new(Counters::default());
    (Probe { ring: producer, counters: Arc::clone(&counters) }, Collector::new(process, consumer, counters))
}

impl Probe {
    /// A duration of `ns` that ended at `at`.
    pub fn record_ns(&mut self, metric: Metric, at: Stamp, ns: u64) {
        self.put(Entry::Sample { metric, at, ns });
    }

    /// The time from `from` to `to`; zero if `to` is earlier.
    pub fn record(&mut self, metric: Metric, from: Stamp, to: Stamp) {
        self.record_ns(metric, to, to.since(from));
    }

    /// `count` indices of the grid were skipped at once. It comes in bursts: ten seconds of it are one line in the log.
    pub fn missed(&mut self, count: u64) {
        self.counters.add(Counter::MissedDeadlines, count);
        self.put(Entry::Missed(count));
    }

    /// Something that is worth a line in the log.
    pub fn event(&mut self, event: Event) {
        self.put(Entry::Event(event));
    }

    /// The numbers of this process.
    pub fn counters(&self) -> &Counters {
        &self.counters
    }

    fn put(&mut self, entry: Entry) {
        if self.ring.push(entry).is_err() {
            self.counters.add(Counter::RingDropped, 1);
        }
    }
}
