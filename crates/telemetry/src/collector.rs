//! The collector's end of the ring.

use crate::counter::{Counter, Counters};
use crate::event::{Missed, RateLimit};
use crate::lines::{Line, Lines};
use crate::metric::Metric;
use crate::probe::Entry;
use crate::series::Series;
use rtrb::Consumer;
use serde_json::{Map, Value, json};
use std::sync::Arc;
use std::time::Instant;

/// Makes histograms and log lines from the entries that a loop puts into its ring.
#[derive(Debug)]
pub struct Collector {
    process: &'static str,
    /// True without real-time scheduling. Then deadlines are missed, and no line about them is a warning.
    relaxed: bool,
    ring: Consumer<Entry>,
    counters: Arc<Counters>,
    series: [Option<Box<Series>>; Metric::ALL.len()],
    limit: RateLimit,
    missed: Option<Missed>,
    lines: Option<Lines>,
}

impl Collector {
    pub(crate) fn new(process: &'static str, ring: Consumer<Entry>, counters: Arc<Counters>) -> Self {
        let limit = RateLimit::starting_at(Instant::now());
        let series = [const { None }; Metric::ALL.len()];
        Self { process, relaxed: false, ring, counters, series, limit, missed: None, lines: None }
    }

    /// Sets if the process may run without real-time scheduling. Then missed deadlines and gaps are no warnings.
    pub fn relaxed(self, relaxed: bool) -> Self {
        Self { relaxed, ..self }
    }

    /// Returns the name of the process that it collects for.
    pub fn process(&self) -> &'static str {
        self.process
    }

    /// Returns the counters of the process.
    pub fn counters(&self) -> &Counters {
        &self.counters
    }

    /// Takes all entries from the ring. Returns their number.
    pub fn drain(&mut self) -> usize {
        // The log thread starts before there is anything to write, so that no thread starts while the robot
        // moves. It is a child of the collecting thread, and runs on the same cores.
        if self.lines.is_none() {
            self.lines = Lines::start(self.process, self.relaxed);
        }
        let mut taken = 0;
        while let Ok(entry) = self.ring.pop() {
            taken += 1;
            match entry {
                Entry::Sample { metric, at, ns } => {
                    self.series[metric as usize].get_or_insert_default().record(at, ns);
                }
                Entry::Missed(count) => Missed::add(&mut self.missed, Instant::now(), count),
                Entry::Event(event) => {
                    if self.limit.admits(event.kind()) {
                        self.push(Line::Event(event));
                    }
                }
            }
        }
        let now = Instant::now();
        if let Some(held_back) = self.limit.turn(now) {
            if let Some(missed) = self.missed.take_if(|missed| missed.is_due(now)) {
                self.push(Line::Missed(missed, now));
            }
            for (kind, count) in held_back.into_iter().enumerate().filter(|&(_, count)| count > 0) {
                self.push(Line::HeldBack { kind, count });
            }
        }
        taken
    }

    fn push(&mut self, line: Line) {
        if let Some(lines) = &mut self.lines {
            lines.push(line);
        }
    }

    /// Returns the metrics that have samples, with their series.
    pub(crate) fn measured(&self) -> impl Iterator<Item = (Metric, &Series)> {
        Metric::ALL.into_iter().zip(&self.series).filter_map(|(metric, series)| Some((metric, series.as_deref()?)))
    }

    /// Returns `{"metrics": {name: as Series::into_json}, "ring_dropped", "log_lines_lost", "allocations"}`.
    pub fn into_json(mut self) -> Value {
        self.drain();
        if let Some(missed) = self.missed.take() {
            self.push(Line::Missed(missed, Instant::now()));
        }
        let log_lines_lost = self.lines.take().map_or(0, Lines::finish);
        let mut metrics = Map::new();
        for (metric, series) in Metric::ALL.into_iter().zip(self.series) {
            if let Some(series) = series {
                metrics.insert(metric.name().to_owned(), series.into_json());
            }
        }
        json!({
            "metrics": metrics,
            "ring_dropped": self.counters.get(Counter::RingDropped),
            "log_lines_lost": log_lines_lost,
            "allocations": {
                "loop": self.counters.get(Counter::Allocations),
                "transport": self.counters.get(Counter::TransportAllocations),
            },
        })
    }
}
