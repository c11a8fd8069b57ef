//! A duration's histogram over the whole run, and one line for each second of it.

use messages::Stamp;
use rt::Histogram;
use serde_json::{Value, json};

/// Seconds that are kept, an hour and eight minutes. A longer run keeps its first ones, and its whole histogram.
const SECONDS_MAX: usize = 4096;
/// Nanoseconds in a second.
const SECOND_NS: u64 = 1_000_000_000;

/// The series of one metric. It makes all its allocations when it is created.
#[derive(Clone, Debug)]
pub struct Series {
    whole: Histogram,
    /// CLOCK_MONOTONIC second that `current` belongs to.
    second: u64,
    current: Histogram,
    seconds: Vec<[f64; 5]>,
    sum_ns: u128,
}

impl Default for Series {
    fn default() -> Self {
        let seconds = Vec::with_capacity(SECONDS_MAX);
        Self { whole: Histogram::default(), second: 0, current: Histogram::default(), seconds, sum_ns: 0 }
    }
}

impl Series {
    /// Counts a duration of `ns` that ended at `at`.
    pub fn record(&mut self, at: Stamp, ns: u64) {
        let second = at.0 / SECOND_NS;
        if second != self.second {
            self.turn();
            self.second = second;
        }
        self.whole.record_ns(ns);
        self.current.record_ns(ns);
        self.sum_ns += u128::from(ns);
    }

    pub(crate) fn whole(&self) -> &Histogram {
        &self.whole
    }

    pub(crate) fn sum_s(&self) -> f64 {
        self.sum_ns as f64 * 1e-9
    }

    fn turn(&mut self) {
        if self.current.count() > 0 && self.seconds.len() < SECONDS_MAX {
            let current = &self.current;
            let (t_s, count) = (self.second as f64, current.count() as f64);
            let line = [t_s, count, current.quantile_us(0.5), current.quantile_us(0.99), current.max_us()];
            self.seconds.push(line);
        }
        self.current.reset();
    }

    /// Returns `{"count", "p50_us", .., "max_us", "buckets", "seconds"}`. A bucket is [highest duration in it in
    /// ns, count]. A second is [s on CLOCK_MONOTONIC, count, p50, p99 and longest in us].
    pub fn into_json(mut self) -> Value {
        self.turn();
        let mut value = self.whole.to_json();
        value["buckets"] = json!(self.whole.buckets());
        value["seconds"] = json!(self.seconds);
        value
    }
}
