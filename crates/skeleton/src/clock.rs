//! Offset between the client's clock and ours. By contract stamps are of one machine's clock. A client that forwards a
//! camera's stamps has a drifting clock. The offset follows it as long as it drifts no faster than quartz.

use crate::config::{Config, DropReason};
use messages::Stamp;

/// Fastest drift that is followed, parts per million: twice the 500 of the worst quartz.
const DRIFT_MAX_PPM: i64 = 1000;
/// Share of the allowed age by which a frame may be late before the lateness counts as drift. The rest is for jitter.
const LATE_SHARE: (i64, i64) = (3, 4);
/// Longest time without a frame that counts as time of drift, ns.
const UNSEEN_MAX_NS: u64 = 10_000_000_000;
/// Largest move of the offset at once, ns: the fastest drift over that time.
const CREDIT_MAX_NS: i64 = 10_000_000;
/// Largest offset, ns: a day of the fastest drift.
const OFFSET_MAX_NS: i64 = 86_400_000_000;

/// Correction of the client's stamps. It stays zero for a client of the same clock: only a frame from the future
/// or one that is nearly too old changes it.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct ClientClock {
    offset_ns: i64,
    /// Amount by which the offset may still move, ns.
    credit_ns: i64,
    seen: Stamp,
}

impl ClientClock {
    /// Returns the frame's origin on our clock, or the reason for which a frame that arrived at `now` is not
    /// current. Over any time the offset moves by at most [`DRIFT_MAX_PPM`] of it. So a step of the client's clock
    /// and a recording are still refused.
    pub(crate) fn place(&mut self, config: &Config, now: Stamp, origin: Stamp) -> Result<Stamp, DropReason> {
        let (future_max, age_max) = (limited(config.future_max_ns), limited(config.age_max_ns));
        let late_ns = signed_ns(now, origin);
        let age_ns = late_ns.saturating_sub(self.offset_ns);
        let unseen_ns = if self.seen == Stamp::NONE { 0 } else { now.since(self.seen).min(UNSEEN_MAX_NS) };
        let drift_max = unseen_ns as i64 * DRIFT_MAX_PPM / 1_000_000;
        let ahead = age_ns < (-future_max).saturating_sub(drift_max);
        if ahead || age_ns > age_max.saturating_add(drift_max) {
            // It was no drift, or it is over: a stamp that fits our clock needs no offset.
            if self.offset_ns != 0 && (0..=age_max).contains(&late_ns) {
                *self = Self { seen: now, ..Self::default() };
                return Ok(origin);
            }
            return Err(if ahead { DropReason::Future } else { DropReason::Old });
        }
        let tolerated = age_max / LATE_SHARE.1 * LATE_SHARE.0;
        let drifted = if age_ns < 0 { age_ns } else { age_ns.saturating_sub(tolerated).max(0) };
        // Unused credit is kept, because only the earliest or latest frames show the drift.
        let credit = self.credit_ns.saturating_add(drift_max).min(CREDIT_MAX_NS);
        let offset = (self.offset_ns + drifted.clamp(-credit, credit)).clamp(-OFFSET_MAX_NS, OFFSET_MAX_NS);
        let spent = (offset - self.offset_ns).abs();
        let age_ns = (age_ns - (offset - self.offset_ns)).clamp(-future_max, age_max);
        *self = Self { offset_ns: offset, credit_ns: credit - spent, seen: now };
        Ok(Stamp(now.0.saturating_add_signed(-age_ns)))
    }
}

/// Time from `earlier` to `later`, ns.
fn signed_ns(later: Stamp, earlier: Stamp) -> i64 {
    if later >= earlier { limited(later.since(earlier)) } else { -limited(earlier.since(later)) }
}

/// Returns `ns`, limited to the largest `i64`.
fn limited(ns: u64) -> i64 {
    i64::try_from(ns).unwrap_or(i64::MAX)
}

#[cfg(test)]
mod tests {
    use super::*;

    const DAY_S: u64 = 86_400;
    const START_NS: u64 = 1_000_000_000_000;

    /// A day of 60 Hz at this drift, frames late by 5 to 25 ms. Returns the number of refused frames and the worst
    /// error of an origin, ns.
    fn day(drift_ppm: i64) -> (u64, u64) {
        let (config, mut clock) = (Config::default(), ClientClock::default());
        let (mut refused, mut worst) = (0, 0);
        for i in 0..DAY_S * 60 {
            let true_ns = i * 1_000_000_000 / 60;
            let shown = Stamp((START_NS + true_ns).saturating_add_signed(true_ns as i64 / 1_000_000 * drift_ppm));
            let late_ns = 5_000_000 + i * 7_368_787 % 20_000_000;
            let placed = clock.place(&config, Stamp(START_NS + true_ns + late_ns), shown);
            refused += u64::from(placed.is_err());
            worst = worst.max(placed.map_or(0, |origin| origin.0.abs_diff(START_NS + true_ns)));
        }
        (refused, worst)
    }

    #[test]
    fn f029_clock_drift_of_500_ppm_for_a_day_drops_no_frame() {
        for drift_ppm in [-500, 0, 500] {
            let (refused, worst) = day(drift_ppm);
            assert_eq!(refused, 0, "{drift_ppm} ppm");
            // A clock that is ahead is noticed at its arrival at the latest. One that is behind is noticed at
            // three quarters of the allowed age.
            assert!(worst <= if drift_ppm == 0 { 0 } else { 76_000_000 }, "{drift_ppm} ppm: {worst} ns");
        }
        assert!(day(2000).0 > DAY_S, "no quartz is that fast");
    }

    #[test]
    fn f029_frames_after_clock_step_are_dropped() {
        let config = Config::default();
        for (step_ns, reason) in [(3_600_000_000_000_i64, DropReason::Future), (-3_600_000_000_000, DropReason::Old)] {
            let mut clock = ClientClock::default();
            let mut at = |s: u64, step_ns: i64| {
                let now = Stamp(2 * 3_600_000_000_000 + s * 1_000_000_000);
                clock.place(&config, now, Stamp(now.0.saturating_add_signed(step_ns)))
            };
            assert!(at(0, 0).is_ok());
            for s in 1..100 {
                assert_eq!(at(s, step_ns), Err(reason));
            }
            assert!(at(100, 0).is_ok(), "and what is of now again is taken");
        }
    }

    #[test]
    fn f029_clock_offset_is_bounded_and_grows_only_with_frames() {
        let config = Config::default();
        let far = Stamp(1 << 62);
        let mut clock = ClientClock { offset_ns: OFFSET_MAX_NS, credit_ns: 0, seen: far };
        // Later than tolerated, and no offset left to correct it.
        let now = far.plus_ns(1_000_000_000);
        assert!(clock.place(&config, now, Stamp(now.0 - OFFSET_MAX_NS as u64 - 100_000_000)).is_ok());
        assert_eq!(clock.offset_ns, OFFSET_MAX_NS);
        // An hour without a frame allows for no more than ten seconds of drift.
        let mut clock = ClientClock { offset_ns: 0, credit_ns: 0, seen: far };
        let now = far.plus_ns(3_600_000_000_000);
        assert_eq!(clock.place(&config, now, now.plus_ns(12_000_001)), Err(DropReason::Future));
        assert_eq!(clock.place(&config, now, now.plus_ns(12_000_000)), Ok(now.plus_ns(2_000_000)));
        for stamp in [Stamp(1), Stamp(u64::MAX)] {
            assert!(clock.place(&config, stamp, Stamp(u64::MAX - stamp.0)).is_err());
        }
    }

    #[test]
    fn f029_clock_offset_returns_to_zero_when_queue_empties() {
        let (config, mut clock) = (Config::default(), ClientClock::default());
        let frame = |clock: &mut ClientClock, i: u64, late_ns: u64| {
            let now = Stamp(START_NS + i * 10_000_000);
            clock.place(&config, now, Stamp(now.0 - late_ns)).map(|origin| now.since(origin))
        };
        // 0.5 ms more every second, for ten minutes.
        assert!((0..60_000).all(|i| frame(&mut clock, i, 20_000_000 + i * 5000).is_ok()));
        assert!(clock.offset_ns > 200_000_000, "{}", clock.offset_ns);
        assert_eq!(frame(&mut clock, 60_001, 20_000_000), Ok(20_000_000));
        assert_eq!(clock.offset_ns, 0);
    }
}
