//! The rate limit for the frames of one publisher, and for each kind of datagram of a link.

use crate::time::Stamp;

/// Frames per second of one publisher that the daemon uses. The fastest supported tracker sends 240.
pub const RATE_MAX_HZ: u64 = 250;
/// Frames that may come at once. Assumption: a network or a busy machine delays frames by up to 64 ms.
pub const BURST: u64 = 16;

/// Time that earns one frame, ns.
const PERIOD_NS: u64 = 1_000_000_000 / RATE_MAX_HZ;

/// A token bucket, stored as the time up to which its tokens are spent (GCRA, ITU-T I.371).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Bucket {
    spent_until: Stamp,
}

impl Bucket {
    /// Takes a token. Returns `false` if there is none.
    pub fn admit(&mut self, now: Stamp) -> bool {
        let admitted = now >= self.next();
        if admitted {
            self.spent_until = self.spent_until.max(now).plus_ns(PERIOD_NS);
        }
        admitted
    }

    /// Returns the time of the next token.
    pub fn next(&self) -> Stamp {
        Stamp(self.spent_until.0.saturating_sub((BURST - 1) * PERIOD_NS))
    }
}
