//! Latencies, recorded without allocating and reported in microseconds.

/// Longest duration with a bucket of its own, 10 s. Longer ones count in the last bucket, and `max_us` stays exact.
const LONGEST_NS: u64 = 10_000_000_000;
/// Significant digits: 3 gives 0.1 % of resolution in 200 KB.
const DIGITS: u8 = 3;

/// A histogram of durations with a fixed range. `record_ns` never allocates.
#[derive(Clone, Debug)]
pub struct Histogram {
    buckets: hdrhistogram::Histogram<u64>,
    max_ns: u64,
}

impl Default for Histogram {
    fn default() -> Self {
        Self::with_digits(DIGITS)
    }
}

impl Histogram {
    /// Creates an empty histogram, with all its allocations, of 1 to 5 significant digits. Two take an eighth of the memory of three.
    pub fn with_digits(digits: u8) -> Self {
        let buckets = hdrhistogram::Histogram::new_with_bounds(1, LONGEST_NS, digits).expect("the bounds are valid");
        Self { buckets, max_ns: 0 }
    }

    /// Counts one duration, in ns.
    pub fn record_ns(&mut self, ns: u64) {
        self.record_n_ns(ns, 1);
    }

    /// Counts `count` durations of `ns`.
    pub fn record_n_ns(&mut self, ns: u64, count: u64) {
        self.max_ns = self.max_ns.max(if count > 0 { ns } else { 0 });
        self.buckets.saturating_record_n(ns, count);
    }

    /// Adds all counts of `other`.
    pub fn merge(&mut self, other: &Self) {
        // Both have the same bounds.
        self.buckets += &other.buckets;
        self.max_ns = self.max_ns.max(other.max_ns);
    }

    /// Returns the number of counted durations.
    pub fn count(&self) -> u64 {
        self.buckets.len()
    }

    /// Returns the duration, in us, that `quantile` (0 to 1) of all do not exceed. It is zero while empty.
    pub fn quantile_us(&self, quantile: f64) -> f64 {
        self.buckets.value_at_quantile(quantile).min(self.max_ns) as f64 * 1e-3
    }

    /// Returns the longest duration in us, exact.
    pub fn max_us(&self) -> f64 {
        self.max_ns as f64 * 1e-3
    }

    /// Clears all counts and keeps the memory.
    pub fn reset(&mut self) {
        self.buckets.reset();
        self.max_ns = 0;
    }

    /// Returns the buckets with a count, ascending: the longest duration of each, ns, and its count.
    pub fn buckets(&self) -> Vec<(u64, u64)> {
        let recorded = self.buckets.iter_recorded();
        recorded.map(|bucket| (bucket.value_iterated_to(), bucket.count_since_last_iteration())).collect()
    }

    /// Returns `{"count", "p50_us", "p99_us", "p99_9_us", "p99_99_us", "max_us"}`.
    pub fn to_json(&self) -> serde_json::Value {
        serde_json::json!({
            "count": self.count(),
            "p50_us": self.quantile_us(0.5),
            "p99_us": self.quantile_us(0.99),
            "p99_9_us": self.quantile_us(0.999),
            "p99_99_us": self.quantile_us(0.9999),
            "max_us": self.max_us(),
        })
    }
}

impl std::fmt::Display for Histogram {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let [p50, p99, p99_9] = [0.5, 0.99, 0.999].map(|quantile| self.quantile_us(quantile));
        let (count, max) = (self.count(), self.max_us());
        write!(f, "n {count}, p50 {p50:.1} us, p99 {p99:.1} us, p99.9 {p99_9:.1} us, max {max:.1} us")
    }
}
