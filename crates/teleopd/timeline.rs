//! Records the ticks that a process ran. "Ticks plus missed deadlines" can then be counted over any common window.

use serde::{Deserialize, Serialize};

/// Number of runs of consecutive ticks that are kept. A process that is interrupted more often has worse problems
/// than an incomplete record.
const RUNS_MAX: usize = 65_536;

/// Runs of consecutive tick indices, in order. Never allocates after creation.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub struct Timeline {
    runs: Vec<(u64, u64)>,
    lost: u64,
}

impl Timeline {
    pub fn new() -> Self {
        Self { runs: Vec::with_capacity(RUNS_MAX), lost: 0 }
    }

    /// Records that tick `k` ran. `k` must not decrease.
    pub fn add(&mut self, k: u64) {
        let room = self.runs.len() < RUNS_MAX;
        match self.runs.last_mut() {
            Some((first, length)) if *first + *length == k => *length += 1,
            Some((first, length)) if k < *first + *length => {}
            _ if room => self.runs.push((k, 1)),
            _ => self.lost += 1,
        }
    }

    /// Records that a process with another cycle ran until tick `k`. If it `paused`, the ticks before are missing.
    pub fn add_until(&mut self, k: u64, paused: bool) {
        let next = self.span().map_or(k, |(_, last)| last + 1);
        (if paused { k } else { next }..=k).for_each(|k| self.add(k));
    }

    pub fn ticks_within(&self, first: u64, last: u64) -> u64 {
        let end = last.saturating_add(1);
        let within = |&(start, length): &(u64, u64)| (start + length).min(end).saturating_sub(start.max(first));
        self.runs.iter().map(within).sum()
    }

    /// The longest pause between two ticks from tick `first` on: its first missing tick, and their number.
    pub fn longest_pause(&self, first: u64) -> Option<(u64, u64)> {
        let ends = |pair: &[(u64, u64)]| pair[0].0 + pair[0].1;
        let pauses = self.runs.windows(2).map(|pair| (ends(pair), pair[1].0 - ends(pair)));
        pauses.filter(|(k, _)| *k >= first).max_by_key(|(_, ticks)| *ticks)
    }

    pub fn span(&self) -> Option<(u64, u64)> {
        let first = self.runs.first()?.0;
        let (start, length) = *self.runs.last()?;
        Some((first, start + length - 1))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_counted_in_any_window_with_gaps() {
        let mut timeline = Timeline::new();
        for k in (10..20).chain(25..30).chain(31..40) {
            timeline.add(k);
        }
        timeline.add(39);
        assert_eq!(timeline.span(), Some((10, 39)));
        assert_eq!(timeline.ticks_within(10, 39), 24);
        assert_eq!((timeline.longest_pause(0), timeline.longest_pause(21)), (Some((20, 5)), Some((30, 1))));
        assert_eq!(timeline.ticks_within(0, 9), 0);
        assert_eq!(timeline.ticks_within(18, 26), 4);
        let again = Timeline::deserialize(serde_json::to_value(&timeline).unwrap()).unwrap();
        assert_eq!(again.ticks_within(18, 26), 4);
    }
}
