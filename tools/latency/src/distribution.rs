//! Durations of one kind, merged from blocks, and their statistics.

use rt::Histogram;
use serde::Deserialize;
use serde_json::{Value, json};

#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
pub struct Second {
    /// Start of the second, CLOCK_MONOTONIC, s.
    pub at_s: f64,
    pub count: f64,
    pub p50_us: f64,
    pub p99_us: f64,
    pub max_us: f64,
}

/// The record of a process, as `telemetry::Series` writes it.
#[derive(Deserialize)]
struct Record {
    buckets: Vec<(u64, u64)>,
    max_us: f64,
    seconds: Vec<Second>,
}

#[derive(Clone, Debug, Default, Deserialize)]
#[serde(from = "Record")]
pub struct Distribution {
    all: Histogram,
    /// The seconds, in order of time within each block.
    pub seconds: Vec<Second>,
}

impl From<Record> for Distribution {
    fn from(Record { buckets, max_us, seconds }: Record) -> Self {
        let mut all = Self { seconds, ..Self::default() };
        // The upper bound of the last bucket was not measured. The maximum was, and it lies in that bucket.
        let max_ns = (max_us * 1e3).round() as u64;
        buckets.into_iter().for_each(|(upper_ns, count)| all.record(upper_ns.min(max_ns), count));
        all
    }
}

impl Distribution {
    pub fn record(&mut self, ns: u64, count: u64) {
        self.all.record_n_ns(ns, count);
    }

    pub fn merge(&mut self, other: &Self) {
        self.all.merge(&other.all);
        self.seconds.extend_from_slice(&other.seconds);
    }

    pub fn count(&self) -> u64 {
        self.all.count()
    }

    /// Returns the duration, us, that a share `quantile` (0 to 1) of all durations does not exceed. None while empty.
    pub fn quantile_us(&self, quantile: f64) -> Option<f64> {
        (self.count() > 0).then(|| self.all.quantile_us(quantile))
    }

    pub fn max_us(&self) -> f64 {
        self.all.max_us()
    }

    /// Returns durations, us, and the fraction of all durations that exceed each: the complement of the
    /// cumulative distribution, in steps of a hundredth of the fraction.
    pub fn tail(&self) -> Vec<(f64, f64)> {
        let (all, mut left, mut steps) = (self.count(), self.count(), vec![(0.0, 1.0)]);
        for (upper_ns, count) in self.all.buckets() {
            left -= count;
            let share = left as f64 / all as f64;
            if steps.last().is_none_or(|(_, before)| share <= 0.99 * before) {
                steps.push(((upper_ns as f64 * 1e-3).min(self.max_us()), share));
            }
        }
        steps
    }

    /// Returns `{"p50", "p99", "p99_9", "p99_99", "max", "count"}` in us, what [`Self::tail`] returns, and of each second its start
    /// (s), p50, p99 and maximum. None while empty.
    pub fn to_json(&self) -> Option<Value> {
        let [p50, p99, p99_9, p99_99] = QUANTILES.map(|quantile| self.quantile_us(quantile));
        p50?;
        Some(json!({
            "p50": p50, "p99": p99, "p99_9": p99_9, "p99_99": p99_99, "max": self.max_us(), "count": self.count(),
            "tail": self.tail(),
            "seconds": self.seconds.iter().map(|one| [one.at_s, one.p50_us, one.p99_us, one.max_us]).collect::<Vec<_>>(),
        }))
    }
}

pub const QUANTILES: [f64; 4] = [0.5, 0.99, 0.999, 0.9999];

#[cfg(test)]
mod tests {
    use super::*;
    use messages::Stamp;
    use telemetry::Series;

    fn from_values(values: impl IntoIterator<Item = u64>) -> Distribution {
        let mut all = Distribution::default();
        values.into_iter().for_each(|ns| all.record(ns, 1));
        all
    }

    #[test]
    fn merged_blocks_equal_one_recording_of_all() {
        let (low, high) = ((1..500).map(|i| i * 37), (500..1000).map(|i| i * 1_037));
        let (mut merged, whole) = (from_values(low.clone()), from_values(low.chain(high.clone())));
        merged.merge(&from_values(high));
        assert_eq!(merged.to_json(), whole.to_json());
        assert!(Distribution::default().to_json().is_none(), "an empty record has no figures");
    }

    #[test]
    fn distribution_is_read_back_from_json_unchanged() {
        let mut series = Series::default();
        let mut whole = Distribution::default();
        for i in 0..4000_u64 {
            let ns = 20_000 + i % 1500 * 100 + u64::from(i == 3000) * 5_000_000;
            series.record(Stamp(i * 667_000), ns);
            whole.record(ns, 1);
        }
        let read = Distribution::deserialize(series.into_json()).expect("its own form");
        assert_eq!(read.tail(), whole.tail());
        assert_eq!(read.seconds.len(), 3);
        assert_eq!(read.seconds.iter().map(|second| second.count).sum::<f64>(), 4000.0);
        assert!(read.seconds.windows(2).all(|pair| pair[0].at_s < pair[1].at_s));
        assert_eq!(read.seconds[2].max_us, read.max_us());
    }

    #[test]
    fn distribution_tail_falls_from_one_to_zero() {
        let tail = from_values([10, 20, 20, 40_000].map(|us| us * 1_000)).tail();
        assert_eq!((tail[0].1, tail[tail.len() - 1].1), (1.0, 0.0));
        assert!(tail.windows(2).all(|pair| pair[0].0 <= pair[1].0 && pair[0].1 >= pair[1].1));
    }
}
