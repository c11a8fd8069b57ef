//! The shared tick grid: every index is either ticked once or counted as missed.

use crate::clock::now;
use crate::shutdown::Shutdown;
use messages::{Stamp, deadline, tick_at};

/// A tick to be done now.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Tick {
    /// Tick index on the grid that all processes share.
    pub k: u64,
    /// Time when the thread woke.
    pub woke: Stamp,
    /// Nanoseconds from the awaited deadline to `woke`.
    pub late_ns: u64,
    /// Indices skipped between the previous tick and this one.
    pub missed: u64,
}

/// Bookkeeping of the grid, without a clock. Catching up skips indices. It never issues two ticks for one wake-up.
#[derive(Clone, Debug)]
pub struct TickGrid {
    first_k: u64,
    next_k: u64,
    ticks: u64,
    missed: u64,
}

impl TickGrid {
    /// Begins with index `first_k`.
    pub fn starting_at(first_k: u64) -> Self {
        Self { first_k, next_k: first_k, ticks: 0, missed: 0 }
    }

    /// Begins with the first index whose deadline lies after `now`.
    pub fn after(now: Stamp) -> Self {
        Self::starting_at(tick_at(now) + 1)
    }

    /// Returns the next index to wait for.
    pub fn next_k(&self) -> u64 {
        self.next_k
    }

    /// Returns the next deadline to wait for.
    pub fn next_deadline(&self) -> Stamp {
        deadline(self.next_k)
    }

    /// Begins index `k`, for a stage that something other than its deadline wakes. Returns how many indices were
    /// skipped, or `None` if `k` has already begun or was skipped.
    pub fn begin(&mut self, k: u64) -> Option<u64> {
        let skipped = k.checked_sub(self.next_k)?;
        self.missed += skipped;
        self.ticks += 1;
        self.next_k = k + 1;
        Some(skipped)
    }

    /// Takes the newest index that is due at `woke`. Returns `None` if none is due.
    pub fn wake(&mut self, woke: Stamp) -> Option<Tick> {
        let waited_for = self.next_deadline();
        let k = tick_at(woke);
        let missed = self.begin(k)?;
        Some(Tick { k, woke, late_ns: woke.since(waited_for), missed })
    }

    /// Returns the number of issued ticks.
    pub fn ticks(&self) -> u64 {
        self.ticks
    }

    /// Returns the number of skipped indices.
    pub fn missed(&self) -> u64 {
        self.missed
    }

    /// Returns the number of indices that have passed since the start: always `ticks + missed`.
    pub fn elapsed(&self) -> u64 {
        self.next_k - self.first_k
    }
}

/// Longest time that a loop may spin before each deadline: 30 % of a tick.
const SPIN_MAX_NS: u64 = 200_000;

/// Sleeps from deadline to deadline.
#[derive(Clone, Debug)]
pub struct PeriodicLoop {
    grid: TickGrid,
    spin_ns: u64,
}

impl PeriodicLoop {
    /// Begins at the next deadline.
    pub fn start() -> Self {
        Self { grid: TickGrid::after(now()), spin_ns: 0 }
    }

    /// Sleeps only until `spin_us` (0 to 200) before each deadline and watches the clock from there. It wakes
    /// closer to the deadline, but keeps a core busy meanwhile.
    pub fn spinning_us(mut self, spin_us: f64) -> Self {
        self.spin_ns = ((spin_us * 1e3) as u64).min(SPIN_MAX_NS);
        self
    }

    /// Waits for the next deadline. Returns `None` once a shutdown is requested.
    #[allow(clippy::should_implement_trait)]
    pub fn next(&mut self, shutdown: &Shutdown) -> Option<Tick> {
        loop {
            let deadline = self.grid.next_deadline();
            let spin_from = Stamp(deadline.0.saturating_sub(self.spin_ns));
            if !shutdown.sleep_until(spin_from) || !shutdown.spin_until(deadline) {
                return None;
            }
            if let Some(tick) = self.grid.wake(now()) {
                return Some(tick);
            }
        }
    }

    /// Returns the bookkeeping.
    pub fn grid(&self) -> &TickGrid {
        &self.grid
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spin_time_is_bounded() {
        let spins = |spin_us| PeriodicLoop::start().spinning_us(spin_us).spin_ns;
        assert_eq!([0.0, 100.0, 1e9, -1.0, f64::NAN].map(spins), [0, 100_000, SPIN_MAX_NS, 0, 0]);
    }
}
