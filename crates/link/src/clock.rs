//! The clock of the other end, by NTP's exchange (RFC 5905, section 8).
//!
//! A frame of ours leaves at `t1` on our clock and arrives at `t2` on theirs. A frame of theirs leaves at `t3` and arrives at
//! `t4`. It echoes `t1` and `t2`. Then
//!
//! - theta = ((t1 - t2) + (t4 - t3)) / 2 is our clock minus theirs,
//! - delta = (t4 - t1) - (t3 - t2) is the time on the way, there and back.
//!
//! Whatever the two ways take, theta is wrong by at most delta / 2. The clocks drift apart by at most 1000 ppm. So for
//! an instant that is at most 100 ms before now, a sample that began at `t1` is wrong by at most delta / 2 + (now - t1
//! + 100 ms) * 1000 ppm. Of the samples of the last 10 s the one with the smallest such uncertainty is used.

use messages::Stamp;

/// Largest drift between two clocks, parts per million. NTP assumes 15 for a good oscillator and refuses 500 (RFC 5905).
/// Assumption: twice that covers every machine.
const DRIFT_PPM: u64 = 1000;
/// Age of the instants that are placed, ns: what is older is refused.
const INSTANT_AGE_MAX_NS: u64 = 100_000_000;
/// Time that one place of the table stands for: 10 exchanges a second.
const PLACE_NS: u64 = 100_000_000;
/// Places of the table: 10 s.
const PLACES: usize = 100;
/// Age of the best sample from which the clock is not synchronised, ns.
const SAMPLE_AGE_MAX_NS: u64 = PLACE_NS * PLACES as u64;
/// Longest time from the arrival of a frame to its echo, ns. Assumption: both ends send ten times a second at least.
const ECHO_AGE_MAX_NS: u64 = 1_000_000_000;
/// Exchanges until a clock is synchronised. Assumption: three that agree are no accident.
const SAMPLES_MIN: u32 = 3;

/// One exchange.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sample {
    /// Our frame left, on our clock.
    pub t1: Stamp,
    /// It arrived, on their clock.
    pub t2: Stamp,
    /// Their frame left, on their clock.
    pub t3: Stamp,
    /// It arrived, on our clock.
    pub t4: Stamp,
}

#[derive(Clone, Copy, Debug, Default)]
struct Measured {
    /// Our clock minus theirs, ns.
    theta_ns: i64,
    /// Time on the way, ns.
    delta_ns: u64,
    /// Beginning of the exchange, on our clock. Zero for an empty place.
    at: Stamp,
}

impl Measured {
    fn uncertainty_ns(&self, now: Stamp) -> u64 {
        let age_ns = now.since(self.at).saturating_add(INSTANT_AGE_MAX_NS);
        (self.delta_ns / 2).saturating_add(age_ns.div_ceil(1_000_000).saturating_mul(DRIFT_PPM))
    }
}

/// The other end's clock, as far as it is known.
#[derive(Clone, Copy, Debug)]
pub struct Clock {
    places: [Measured; PLACES],
    samples: u32,
    jumps: u64,
    newest_delta_ns: u64,
    newest_t1: Stamp,
}

impl Default for Clock {
    fn default() -> Self {
        Self { places: [Measured::default(); PLACES], samples: 0, jumps: 0, newest_delta_ns: 0, newest_t1: Stamp::NONE }
    }
}

impl Clock {
    /// Takes an exchange. Returns false if it is none, or if it shows that the other clock has jumped. Then nothing is known
    /// of it any more.
    pub fn add(&mut self, sample: Sample) -> bool {
        let Sample { t1, t2, t3, t4 } = sample;
        let held = i128::from(t3.0) - i128::from(t2.0);
        let away = i128::from(t4.0) - i128::from(t1.0);
        // Their clock may be the faster one.
        let drift = held / 1_000_000 * i128::from(DRIFT_PPM) + i128::from(DRIFT_PPM);
        if !(0..=i128::from(ECHO_AGE_MAX_NS)).contains(&held) || away < held - drift {
            return false;
        }
        let theta = (i128::from(t1.0) - i128::from(t2.0) + i128::from(t4.0) - i128::from(t3.0)) / 2;
        let (Ok(theta_ns), Ok(delta_ns)) = (i64::try_from(theta), u64::try_from((away - held).max(0))) else {
            return false;
        };
        let measured = Measured { theta_ns, delta_ns, at: t1 };
        if self.contradicts(&measured, t4) {
            self.forget();
            return false;
        }
        self.newest_delta_ns = delta_ns;
        // An echo that comes twice is no second exchange.
        self.samples = self.samples.saturating_add(u32::from(t1 != self.newest_t1));
        self.newest_t1 = t1;
        let turn = t1.0 / PLACE_NS;
        if let Some(place) = self.places.get_mut((turn % PLACES as u64) as usize) {
            let same = place.at != Stamp::NONE && place.at.0 / PLACE_NS == turn;
            if !same || delta_ns <= place.delta_ns {
                *place = measured;
            }
        }
        true
    }

    /// Forgets the other clock, because it has jumped.
    pub fn forget(&mut self) {
        *self = Self { jumps: self.jumps.saturating_add(1), ..Self::default() };
    }

    /// Returns how often the other clock has jumped.
    pub fn jumps(&self) -> u64 {
        self.jumps
    }

    /// Returns the time on the way of the newest exchange, there and back, ns. `None` before the first one.
    pub fn round_trip_ns(&self) -> Option<u64> {
        (self.samples > 0).then_some(self.newest_delta_ns)
    }

    /// Returns our clock minus theirs and its uncertainty, ns. `None` while the clocks are not synchronised.
    pub fn offset(&self, now: Stamp) -> Option<(i64, u64)> {
        let best = self.best(now).filter(|_| self.samples >= SAMPLES_MIN)?;
        Some((best.theta_ns, best.uncertainty_ns(now)))
    }

    /// Returns the uncertainty, ns. `None` while the clocks are not synchronised.
    pub fn uncertainty_ns(&self, now: Stamp) -> Option<u64> {
        self.offset(now).map(|(_, uncertainty_ns)| uncertainty_ns)
    }

    /// Returns the earliest time on our clock at which their clock can have shown `theirs`. `None` while the clocks are not
    /// synchronised.
    pub fn earliest(&self, theirs: Stamp, now: Stamp) -> Option<Stamp> {
        let (theta_ns, uncertainty_ns) = self.offset(now)?;
        let ours = i128::from(theirs.0) + i128::from(theta_ns) - i128::from(uncertainty_ns);
        // One and not zero, which means "never".
        Some(Stamp(u64::try_from(ours.clamp(1, i128::from(u64::MAX))).unwrap_or(u64::MAX)))
    }

    fn best(&self, now: Stamp) -> Option<&Measured> {
        let fresh = |place: &&Measured| place.at != Stamp::NONE && now.since(place.at) < SAMPLE_AGE_MAX_NS;
        self.places.iter().filter(fresh).min_by_key(|place| place.uncertainty_ns(now))
    }

    /// Returns true if no constant offset and drift explain both this exchange and the best one.
    fn contradicts(&self, measured: &Measured, now: Stamp) -> bool {
        self.best(now).is_some_and(|best| {
            best.theta_ns.abs_diff(measured.theta_ns)
                > best.uncertainty_ns(now).saturating_add(measured.uncertainty_ns(now))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const MS: u64 = 1_000_000;

    /// An exchange that begins at `t1` with a clock that is behind ours by `behind`.
    fn exchange(t1: u64, there: u64, held: u64, back: u64, behind: u64) -> Sample {
        let t2 = t1 + there - behind;
        Sample { t1: Stamp(t1), t2: Stamp(t2), t3: Stamp(t2 + held), t4: Stamp(t1 + there + held + back) }
    }

    fn synchronised(behind: u64) -> (Clock, Stamp) {
        let mut clock = Clock::default();
        let mut now = 100_000 * MS;
        for _ in 0..5 {
            assert!(clock.add(exchange(now, MS, 2 * MS, MS, behind)));
            now += 100 * MS;
        }
        (clock, Stamp(now))
    }

    #[test]
    fn clock_is_synchronised_after_three_exchanges_and_not_ten_seconds_later() {
        let mut clock = Clock::default();
        for n in 0..3 {
            assert_eq!(clock.offset(Stamp(100_000 * MS)), None);
            assert!(clock.add(exchange((100_000 + n) * MS, MS, 0, MS, 7 * MS)));
        }
        let now = Stamp(100_004 * MS);
        let (theta, uncertainty) = clock.offset(now).expect("synchronised");
        assert_eq!(theta, 7 * MS as i64);
        assert!((MS..MS + 110_000).contains(&uncertainty), "{uncertainty}");
        let later = clock.uncertainty_ns(now.plus_ns(5000 * MS)).expect("synchronised");
        assert!(later - uncertainty >= 5 * MS, "1000 ppm of 5 s: {later}");
        assert_eq!(clock.offset(now.plus_ns(10_000 * MS)), None);
    }

    #[test]
    fn f127_jump_of_the_other_clock_leaves_it_unsynchronised() {
        let (mut clock, now) = synchronised(7 * MS);
        assert!(!clock.add(exchange(now.0, MS, MS, MS, 7 * MS + 20 * MS)));
        assert_eq!((clock.jumps(), clock.offset(now)), (1, None));
        // It is known again after the three exchanges that the first synchronisation took.
        for n in 1..=3 {
            assert_eq!(clock.offset(now), None);
            assert!(clock.add(exchange(now.0 + n * 100 * MS, MS, MS, MS, 27 * MS)));
        }
        assert_eq!(clock.offset(now.plus_ns(400 * MS)).expect("synchronised").0, 27 * MS as i64);
    }

    #[test]
    fn frame_that_is_taken_and_answered_at_a_stale_time_looks_like_a_jump() {
        let (clock, now) = synchronised(7 * MS);
        let fresh = exchange(now.0, MS, 0, MS, 7 * MS);
        let stale = Sample { t2: Stamp(fresh.t2.0 - 5 * MS), t3: Stamp(fresh.t3.0 - 5 * MS), ..fresh };
        for (sample, jumps) in [(fresh, 0), (stale, 1)] {
            let clock = &mut clock.clone();
            assert_eq!((clock.add(sample), clock.jumps()), (jumps == 0, jumps));
        }
    }

    #[test]
    fn impossible_exchange_is_refused_and_changes_nothing() {
        let (clock, now) = synchronised(7 * MS);
        let before = clock.offset(now);
        let good = exchange(now.0, MS, MS, MS, 7 * MS);
        for bad in [
            Sample { t3: Stamp(good.t2.0 - 1), ..good },
            Sample { t4: Stamp(good.t1.0 + MS / 2), ..good },
            Sample { t2: Stamp(0), ..good },
            Sample { t1: Stamp(u64::MAX), ..good },
            Sample { t2: Stamp(u64::MAX), t3: Stamp(u64::MAX), ..good },
        ] {
            let clock = &mut clock.clone();
            assert!(!clock.add(bad), "{bad:?}");
        }
        assert_eq!(clock.offset(now), before);
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(300))]
        /// Drift below the bound, and ways that take whatever they take.
        #[test]
        fn f126_earliest_time_is_never_later_than_the_true_one(
            ways in prop::collection::vec((0_u64..200, 0_u64..200, 0_u64..50), 3..150),
            drift_ppm in -900_i64..900,
            behind in 0_u64..50_000,
        ) {
            let theirs = |ours: u64| (ours as i128 + (ours as i128 * i128::from(drift_ppm)) / 1_000_000) as u64 - behind * MS;
            let (mut clock, mut now) = (Clock::default(), 100_000 * MS);
            for (there, back, held) in ways {
                let (t1, t2) = (now, theirs(now + there * MS));
                let left = now + (there + held) * MS;
                now = left + back * MS;
                let sample = Sample { t1: Stamp(t1), t2: Stamp(t2), t3: Stamp(theirs(left)), t4: Stamp(now) };
                prop_assert!(clock.add(sample), "{sample:?}");
                let truth = now - 30 * MS;
                if let Some(earliest) = clock.earliest(Stamp(theirs(truth)), Stamp(now)) {
                    let (_, uncertainty) = clock.offset(Stamp(now)).expect("synchronised");
                    prop_assert!(earliest.0 <= truth, "{} ns late", earliest.0 - truth);
                    prop_assert!(truth - earliest.0 <= 2 * uncertainty);
                }
            }
        }
    }
}
