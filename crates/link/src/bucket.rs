//! The rate limit of one kind of datagram of one operator.

use messages::Stamp;

/// Datagrams that may come at once. Assumption: a network delays them by up to 64 ms.
const BURST: u64 = 16;

/// A token bucket, stored as the time up to which its tokens are spent (GCRA, ITU-T I.371).
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Bucket {
    spent_until: Stamp,
}

impl Bucket {
    /// Takes a token, of which `period_ns` earns one. Returns false if there is none.
    pub(crate) fn take(&mut self, now: Stamp, period_ns: u64) -> bool {
        let admitted = self.spent_until.since(now) <= (BURST - 1) * period_ns;
        if admitted {
            self.spent_until = self.spent_until.max(now).plus_ns(period_ns);
        }
        admitted
    }
}
