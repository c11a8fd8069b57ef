//! The blocks of a run: the order of the measurements, and the length of each.

messages::named! {
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub enum Kind {
        /// The processes, each woken by its input.
        Events => "events",
        /// The processes, each polling its input once a tick.
        Polled => "polled",
        /// cyclictest, alone.
        Cyclictest => "cyclictest",
        /// Our own clock_nanosleep loop, alone.
        Probe => "probe",
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Block {
    pub kind: Kind,
    /// Length, s.
    pub seconds: f64,
}

/// Length of a round if nothing else bounds the number of rounds. It is short enough for a machine whose load
/// drifts by the minute.
const ROUND_S: f64 = 30.0;
/// Smallest number of rounds. A single round could not separate drift from the difference between variants.
const ROUNDS_MIN: f64 = 2.0;
/// Largest number of rounds. Starting and engaging costs some seconds per block.
const ROUNDS_MAX: f64 = 6.0;
/// Share of the measured time of each kind. If cyclictest is missing, the probe also gets its share.
const SHARES: [(Kind, f64); 4] =
    [(Kind::Events, 0.6), (Kind::Cyclictest, 0.1), (Kind::Polled, 0.2), (Kind::Probe, 0.1)];
/// Shortest block, s. In a short run `BLOCK_MIN_SHARE` applies instead.
const BLOCK_MIN_S: f64 = 2.0;
/// Shortest block of a short run, as a share of the run.
const BLOCK_MIN_SHARE: f64 = 0.125;

/// Returns the blocks of a run of `seconds`, in order. Each kind occurs once per round.
pub fn plan(seconds: f64, cyclictest: bool) -> Vec<Block> {
    let rounds = (seconds / ROUND_S).clamp(ROUNDS_MIN, ROUNDS_MAX).floor();
    let shortest = BLOCK_MIN_S.min(seconds * BLOCK_MIN_SHARE);
    let mut blocks = Vec::new();
    for _ in 0..rounds as usize {
        for (kind, share) in SHARES {
            let share = match kind {
                Kind::Cyclictest if !cyclictest => continue,
                Kind::Probe if !cyclictest => 2.0 * share,
                _ => share,
            };
            blocks.push(Block { kind, seconds: (seconds * share / rounds).max(shortest) });
        }
    }
    blocks
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn block_plan_runs_every_kind_in_each_of_two_or_more_rounds() {
        for (seconds, rounds) in [(2.0, 2), (5.0, 2), (60.0, 2), (100.0, 3), (86_400.0, 6)] {
            for cyclictest in [true, false] {
                let blocks = plan(seconds, cyclictest);
                let kinds: Vec<_> = blocks.iter().map(|block| block.kind).collect();
                let all = [Kind::Events, Kind::Cyclictest, Kind::Polled, Kind::Probe];
                let round: Vec<_> = all.into_iter().filter(|kind| cyclictest || *kind != Kind::Cyclictest).collect();
                assert_eq!(kinds, round.repeat(rounds), "{seconds} s");
            }
        }
    }

    #[test]
    fn block_plan_spends_60_percent_on_events_and_no_block_below_2_s() {
        for seconds in [20.0, 60.0, 600.0, 7200.0] {
            let blocks = plan(seconds, true);
            assert!(blocks.iter().all(|block| block.seconds >= 2.0), "{seconds} s: {blocks:?}");
            let events = blocks.iter().filter(|block| block.kind == Kind::Events);
            let events_s: f64 = events.map(|block| block.seconds).sum();
            assert!((events_s - 0.6 * seconds).abs() < 1e-9, "{seconds} s: {events_s} s");
        }
    }
}
