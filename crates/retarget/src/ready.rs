//! Whether the input is steady enough to begin upon. What is followed may falter for as long as it is not stale; what is
//! engaged upon, at first or again after a hold, has to have come often enough for a while.

use messages::Stamp;

use crate::resample::STALE_NS;
use crate::tick::ARMS;

/// How long the input is watched, ns: half the blend that a person has to let go in, and long beside a period at 20 Hz.
const WATCHED_NS: u64 = 500_000_000;
/// How long it is watched if it was steady not long ago, ns: four skeletons at 20 Hz. Nothing but a gap came between.
const WATCHED_AGAIN_NS: u64 = 200_000_000;
/// How long ago, ns: as long as `safety` lets a gap last.
const AGAIN_NS: u64 = 2_000_000_000;
/// Longest mean period in that time, ns: that of 20 Hz, and 15 ms more over ten of them for jitter. 19 Hz are too slow.
const PERIOD_MAX_NS: u64 = 51_500_000;

/// Judges the input at every tick.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Readiness {
    begun: Stamp,
    /// The newest skeleton when the watch began, and how many came since.
    first: Stamp,
    count: u32,
    newest: Stamp,
    meant: [bool; ARMS],
    ready: bool,
    /// When the input was ready last; never, for a stranger.
    ready_at: Stamp,
}

impl Readiness {
    /// A skeleton with at least one arm came, at `received`; `restart`: of somebody else, or after silence; `stranger`: of somebody
    /// else.
    pub(crate) fn arrived(&mut self, received: Stamp, restart: bool, stranger: bool) {
        if stranger {
            self.ready_at = Stamp::NONE;
        }
        if restart || stranger || received.since(self.newest) > STALE_NS {
            self.begin(received, received);
        } else {
            self.count = self.count.saturating_add(1);
        }
        self.newest = received;
    }

    /// Whether there is a human to follow: every arm that is meant is fresh, and the same ones have been since the input
    /// was steady.
    pub(crate) fn judge(&mut self, now: Stamp, meant: [bool; ARMS], fresh: [bool; ARMS]) -> bool {
        let seen = meant.contains(&true) && meant == fresh;
        let again = self.ready_at != Stamp::NONE && self.begun.since(self.ready_at) <= AGAIN_NS;
        if meant != self.meant {
            (self.meant, self.ready_at) = (meant, Stamp::NONE);
            self.begin(now, self.newest);
        } else if !seen {
            self.begin(now, self.newest);
        } else if now.since(self.begun) >= if again { WATCHED_AGAIN_NS } else { WATCHED_NS } {
            let periods = u64::from(self.count);
            self.ready |= periods > 0 && self.newest.since(self.first) <= PERIOD_MAX_NS * periods;
            (self.begun, self.first, self.count) = (now, self.newest, 0);
        }
        if self.ready {
            self.ready_at = now;
        }
        self.ready
    }

    /// Watches anew from `now` on; `first` is the newest skeleton.
    fn begin(&mut self, now: Stamp, first: Stamp) {
        (self.begun, self.first, self.count, self.ready) = (now, first, 0, false);
    }
}
