//! Time: stamps of the monotonic clock, and the tick grid that every process shares without a handshake.

use crate::layout::{FNV_BASIS, Layout, fnv, message};

/// Ticks per second of every real-time stage.
pub const TICK_HZ: u64 = 1500;
/// Length of a tick in seconds, for formulas only: deadlines are integers.
pub const TICK_S: f64 = 1.0 / TICK_HZ as f64;

/// Nanoseconds of CLOCK_MONOTONIC; zero means "never".
#[repr(transparent)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct Stamp(pub u64);

impl Layout for Stamp {
    const HASH: u64 = fnv(FNV_BASIS, b"Stamp");
    const ZERO: Self = Self(0);
    fn put(&self, out: &mut [u8]) {
        self.0.put(out);
    }
    fn get(bytes: &[u8]) -> Self {
        Self(u64::get(bytes))
    }
}

impl Stamp {
    /// "Never".
    pub const NONE: Self = Self(0);

    /// Nanoseconds from `earlier` to `self`; zero if `earlier` lies in the future.
    pub const fn since(self, earlier: Self) -> u64 {
        self.0.saturating_sub(earlier.0)
    }

    /// The stamp `ns` nanoseconds later.
    pub const fn plus_ns(self, ns: u64) -> Self {
        Self(self.0.saturating_add(ns))
    }
}

/// The instant of tick `k`: k / 1500 s after the origin of CLOCK_MONOTONIC, in integers (1e9 / 1500 = 2e6 / 3), so
/// there is no drift, and processes agree on `k` without exchanging a start time.
pub const fn deadline(k: u64) -> Stamp {
    Stamp(((k as u128 * 2_000_000).div_ceil(3)) as u64)
}

/// The last tick whose deadline is not after `now`: `deadline(tick_at(t)) <= t < deadline(tick_at(t) + 1)`.
pub const fn tick_at(now: Stamp) -> u64 {
    ((now.0 as u128 * 3) / 2_000_000) as u64
}

/// Whether the sequence number `sequence` comes after `before`. They are compared as serial numbers (RFC 1982), so that
/// they may wrap.
pub const fn comes_after(sequence: u64, before: u64) -> bool {
    let ahead = sequence.wrapping_sub(before);
    ahead != 0 && ahead <= u64::MAX / 2
}

message! {
    /// What every message begins with.
    pub struct Header v 1 size 40 {
        /// Counts the writer's messages from 1.
        pub sequence: u64,
        /// When the message was published.
        pub stamp: Stamp,
        /// When the human was seen; copied unchanged through every hop; zero where no human is behind the message.
        pub origin: Stamp,
        /// Hash of the effective configuration; processes whose hashes differ cannot engage.
        pub config_hash: u64,
        /// Changes at every process start, so that a restarted writer is a stranger.
        pub incarnation: u32,
        /// Zero.
        pub reserved: u32,
    }
}
