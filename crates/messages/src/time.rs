//! Time: stamps of the monotonic clock, and the tick grid that all processes share without a handshake.

use crate::layout::{FNV_BASIS, Layout, fnv, message};

/// Ticks per second of every real-time stage.
pub const TICK_HZ: u64 = 1500;
/// Length of a tick, s. Used in formulas only: deadlines are integers.
pub const TICK_S: f64 = 1.0 / TICK_HZ as f64;

/// Nanoseconds of CLOCK_MONOTONIC. Zero means "never".
#[repr(transparent)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct Stamp(pub u64);

impl Layout for Stamp {
    const HASH: u64 = fnv(FNV_BASIS, b"Stamp");
    const ZERO: Self = Self(0);
    fn write_to(&self, out: &mut [u8]) {
        self.0.write_to(out);
    }
    fn get(bytes: &[u8]) -> Self {
        Self(u64::get(bytes))
    }
}

impl Stamp {
    /// "Never".
    pub const NONE: Self = Self(0);

    /// Returns the nanoseconds from `earlier` to `self`. Returns zero if `earlier` is later than `self`.
    pub const fn since(self, earlier: Self) -> u64 {
        self.0.saturating_sub(earlier.0)
    }

    /// Returns the stamp `ns` nanoseconds later.
    pub const fn plus_ns(self, ns: u64) -> Self {
        Self(self.0.saturating_add(ns))
    }
}

/// Returns the instant of tick `k`: k / 1500 s after the origin of CLOCK_MONOTONIC. It is computed in integers
/// (1e9 / 1500 = 2e6 / 3), so there is no drift. Processes agree on `k` without exchanging a start time.
pub const fn deadline(k: u64) -> Stamp {
    Stamp(((k as u128 * 2_000_000).div_ceil(3)) as u64)
}

/// Returns the last tick whose deadline is not after `now`: `deadline(tick_at(t)) <= t < deadline(tick_at(t) + 1)`.
///
/// ```
/// use messages::{Stamp, deadline, tick_at};
///
/// let now = Stamp(1_000_000);
/// assert_eq!(tick_at(now), 1);
/// assert_eq!(deadline(2).since(now), 333_334); // Sleep this long, ns, until the next tick.
/// ```
pub const fn tick_at(now: Stamp) -> u64 {
    ((now.0 as u128 * 3) / 2_000_000) as u64
}

/// Returns true if the sequence number `sequence` comes after `before`. They are compared as serial numbers (RFC
/// 1982), so they may wrap.
pub const fn comes_after(sequence: u64, before: u64) -> bool {
    let ahead = sequence.wrapping_sub(before);
    ahead != 0 && ahead <= u64::MAX / 2
}

message! {
    /// Beginning of every message.
    pub struct Header v 1 size 40 {
        /// Counts the writer's messages from 1.
        pub sequence: u64,
        /// Time at which the message was published.
        pub stamp: Stamp,
        /// Time at which the person was captured. `ingest` moves it by the drift of the client's clock. Every other process
        /// copies it. Zero if no person is behind the message.
        pub origin: Stamp,
        /// Hash of the effective configuration. Processes whose hashes differ cannot engage.
        pub config_hash: u64,
        /// Number that changes at every process start, so readers notice a restarted writer.
        pub incarnation: u32,
        /// Zero.
        pub reserved: u32,
    }
}
