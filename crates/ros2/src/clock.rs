//! The robot's clock, as its stamps tell it.
//!
//! A stamp s arrives at r. Its delay makes s - r smaller than the offset, and is never negative. So the clock takes the
//! largest s - r of the last ten seconds:
//!
//! ```text
//! offset = max over the last 10 s of (s - r)
//! ```
//!
//! It is too small by the least delay of the network, far less than a millisecond on a cable. The offset in force follows
//! it at no more than 200 ppm, so that a moving robot feels no step: 0.2 mm/s at 1 m/s. Clocks that drift faster lose
//! each other, and the robot is not believed any more.

use messages::Stamp;

/// Length of the window, in parts.
const PARTS: usize = 10;
/// Length of a part, ns.
const PART_NS: u64 = 1_000_000_000;
/// A stamp that differs by more than this from what the offset expects is not believed, ns. The history of each
/// trajectory covers 53 ms and the delay takes 25 of them, so an error of 20 ms still hits the history.
const BELIEVED_NS: i64 = 20_000_000;
/// Stamps in a row that are not believed before the clock counts as changed. At 50 Hz it is 0.2 s.
const CHANGED: u32 = 10;

/// Time after the first stamp in which the offset is taken at once, ns. No robot is driven yet.
pub(crate) const SETTLES_NS: u64 = 1_000_000_000;
/// Largest rate of the offset after that, ns per ns.
const RATE: f64 = 200e-6;

/// Difference between the robot's clock and this machine's.
#[derive(Clone, Copy, Debug, Default)]
pub struct RobotClock {
    /// Largest difference in each part of the window, and the part's number.
    parts: [Option<(u64, i64)>; PARTS],
    /// The offset in force, ns, the time at which it was set, and the time of the first stamp.
    force: Option<(i64, Stamp, Stamp)>,
    rejected_stamps: u32,
}

impl RobotClock {
    /// Takes the stamp of a message (ns of the robot's clock) that arrived at `received`. Returns false if it is not
    /// believed. After ten such stamps in a row the clock begins again.
    pub fn receive(&mut self, stamp_ns: i64, received: Stamp) -> bool {
        let difference = stamp_ns.saturating_sub_unsigned(received.0);
        if let Some(offset) = self.offset_ns() {
            // A stamp may be late by a delay, but not early.
            let early = difference.saturating_sub(offset);
            if !(-5 * BELIEVED_NS..=BELIEVED_NS).contains(&early) {
                self.rejected_stamps += 1;
                if self.rejected_stamps >= CHANGED {
                    *self = Self::default();
                }
                return false;
            }
        }
        self.rejected_stamps = 0;
        let number = received.0 / PART_NS;
        let part = &mut self.parts[(number % PARTS as u64) as usize];
        *part = match *part {
            Some((known, most)) if known == number => Some((number, most.max(difference))),
            _ => Some((number, difference)),
        };
        let newest = self.parts.iter().flatten().map(|(_, most)| *most).max().unwrap_or(difference);
        self.force = Some(match self.force {
            Some((offset, at, begun)) if received.since(begun) > SETTLES_NS => {
                let most = (received.since(at) as f64 * RATE) as i64;
                (offset + (newest - offset).clamp(-most, most), received, begun)
            }
            before => (newest, received, before.map_or(received, |(.., begun)| begun)),
        });
        true
    }

    /// True once the offset no longer changes at once.
    pub fn is_settled(&self, now: Stamp) -> bool {
        self.force.is_some_and(|(.., begun)| now.since(begun) > SETTLES_NS)
    }

    /// The robot's clock minus this machine's, ns. None before the first stamp.
    pub fn offset_ns(&self) -> Option<i64> {
        self.force.map(|(offset, ..)| offset)
    }

    /// This machine's time of a stamp of the robot.
    pub fn here(&self, stamp_ns: i64) -> Option<Stamp> {
        let here = stamp_ns.checked_sub(self.offset_ns()?)?;
        u64::try_from(here).ok().map(Stamp)
    }

    /// The robot's time, ns, at a time of this machine.
    pub fn there_ns(&self, here: Stamp) -> Option<i64> {
        i64::try_from(here.0).ok()?.checked_add(self.offset_ns()?)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};

    const MS: u64 = 1_000_000;

    #[test]
    fn offset_is_found_under_jitter_and_drift() {
        let mut rng = rand_pcg::Pcg64::seed_from_u64(1);
        let mut clock = RobotClock::default();
        for n in 0..3_000 {
            let sent = 5_000_000_000 + n * 20 * MS;
            // The robot's clock is 1.7e18 ns ahead, and gains 200 ppm.
            let offset = 1_700_000_000_000_000_000 + (sent / 5_000) as i64;
            let received = Stamp(sent + rng.random_range(50_000..4 * MS));
            assert!(clock.receive(offset + sent as i64, received), "sample {n}");
            if n > 20 {
                let error = clock.offset_ns().expect("known") - offset;
                assert!((-2_500_000..=100_000).contains(&error), "sample {n}: {error} ns");
            }
        }
    }

    #[test]
    fn f116_jump_is_not_believed_and_then_taken() {
        for jump_ns in [1_000_000_000_i64, -1_000_000_000] {
            let mut clock = RobotClock::default();
            let mut at = 1_000_000_000;
            let mut hear = |clock: &mut RobotClock, offset: i64| {
                at += 20 * MS;
                clock.receive(at as i64 + offset, Stamp(at + MS))
            };
            assert!((0..50).all(|_| hear(&mut clock, 7)));
            let refused = (0..50).filter(|_| !hear(&mut clock, 7 + jump_ns)).count();
            assert_eq!(refused, CHANGED as usize);
            assert!((clock.offset_ns().expect("known") - jump_ns).abs() < 2 * MS as i64);
        }
    }

    #[test]
    fn time_goes_there_and_back() {
        let mut clock = RobotClock::default();
        assert_eq!((clock.here(5), clock.there_ns(Stamp(5))), (None, None));
        clock.receive(1_000, Stamp(400));
        assert_eq!((clock.there_ns(Stamp(500)), clock.here(1_100)), (Some(1_100), Some(Stamp(500))));
        assert_eq!(clock.here(-10_000), None, "before this machine's origin");
    }

    #[test]
    fn f116_clock_settles_a_second_after_its_first_stamp_and_after_each_new_beginning() {
        let mut clock = RobotClock::default();
        let at = |ms: u64| Stamp(5_000_000_000 + ms * 1_000_000);
        let stamp = |ms: u64, ahead_s: i64| at(ms).0.cast_signed() + ahead_s * 1_000_000_000;
        assert!(!clock.is_settled(at(0)) && clock.receive(stamp(0, 7), at(0)));
        assert!(!clock.is_settled(at(1_000)) && clock.is_settled(at(1_001)));
        // After ten stamps that are not believed it begins again. Silence settles nothing.
        (0..10).for_each(|n| assert!(!clock.receive(stamp(1_100 + 20 * n, 9), at(1_100 + 20 * n))));
        assert!(!clock.is_settled(at(4_000)) && clock.receive(stamp(4_000, 9), at(4_000)));
        assert!(!clock.is_settled(at(4_500)) && clock.is_settled(at(5_001)));
    }
}
