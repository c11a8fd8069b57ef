//! Decides whether the input is steady enough to engage. While the robot follows, the input may have gaps until it
//! is stale. To engage, at first or after a hold, skeletons must have come often enough for a while.

use messages::Stamp;

use crate::arm::ARMS;
use crate::resample::STALE_NS;

/// Time for which the input is observed, ns: half the blend in which a person may still let go, and long compared
/// with a period at 15 Hz.
const WATCHED_NS: u64 = 500_000_000;
/// Shorter time if the input was steady not long ago and only a gap came between, ns: that after which a skeleton is stale.
/// It needs three skeletons, the newest no older than the longest period.
const WATCHED_AGAIN_NS: u64 = 100_000_000;
/// Largest age of that steadiness, ns: as long as `safety` lets a gap last.
const AGAIN_NS: u64 = 2_000_000_000;
/// Longest mean period in that time, ns: that of 15 Hz, which webcams fall to in the dark, and 15 ms more over ten periods
/// for jitter. 14 Hz are too slow. A skeleton is stale after 100 ms, so at 15 Hz one lost image holds the robot for a moment.
const PERIOD_MAX_NS: u64 = 68_200_000;

/// Judges the input at every tick.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Readiness {
    begun: Stamp,
    /// The newest skeleton when the observation began, and the number of skeletons since.
    first: Stamp,
    count: u32,
    newest: Stamp,
    in_use: [bool; ARMS],
    ready: bool,
    /// Time at which the input was ready last. `Stamp::NONE` for a new person.
    ready_at: Stamp,
}

impl Readiness {
    /// Counts a skeleton with at least one arm, received at `received`. `restart`: it shows another person, or it
    /// came after silence. `stranger`: it shows another person.
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

    /// Returns true if there is a person to follow. Every arm in use is fresh, and the same arms have been in use
    /// since the input was steady.
    pub(crate) fn judge(&mut self, now: Stamp, in_use: [bool; ARMS], fresh: [bool; ARMS]) -> bool {
        let seen = in_use.contains(&true) && in_use == fresh;
        let again = self.ready_at != Stamp::NONE && self.begun.since(self.ready_at) <= AGAIN_NS;
        let goes_on = self.count >= 2 && now.since(self.newest) <= PERIOD_MAX_NS;
        let watched_ns = if again && goes_on { WATCHED_AGAIN_NS } else { WATCHED_NS };
        if in_use != self.in_use {
            (self.in_use, self.ready_at) = (in_use, Stamp::NONE);
            self.begin(now, self.newest);
        } else if !seen {
            self.begin(now, self.newest);
        } else if now.since(self.begun) >= watched_ns {
            let periods = u64::from(self.count);
            self.ready |= periods > 0 && self.newest.since(self.first) <= PERIOD_MAX_NS * periods;
            (self.begun, self.first, self.count) = (now, self.newest, 0);
        }
        if self.ready {
            self.ready_at = now;
        }
        self.ready
    }

    /// Restarts the observation at `now`. `first` is the newest skeleton.
    fn begin(&mut self, now: Stamp, first: Stamp) {
        (self.begun, self.first, self.count, self.ready) = (now, first, 0, false);
    }
}
