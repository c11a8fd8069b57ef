//! Reduced speed: problems that need not stop the robot make it slow.

use messages::{TICK_HZ, reduced_flag};

use super::watch::charged_ns;
use super::{Config, Input};

/// Share of each velocity limit that is left for a doubtful motion. Shoulder (1.95 rad/s, 0.9 m from the hand) and
/// elbow (2.35 rad/s, 0.45 m) together then move a hand at 0.25 m/s. ISO 10218-1 calls this reduced speed.
pub const SLOW: f64 = 0.09;

/// Time in which the speed returns from zero to full, ns. The operator then feels the return as one motion.
const RISE_NS: f64 = 500e6;

/// Time for which the robot stays slow after several missed deadlines in a row, ns.
const AFTER_DEADLINES_NS: u64 = 1_000_000_000;

/// Jumps that follow each other within this time are one stream of jumps, ns. It is three frames of the
/// slowest camera (30 Hz).
const JUMPS_APART_NS: u64 = 100_000_000;

/// Ages of the streams that determine the speed, ns.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Ages {
    pub(super) target_ns: u64,
    pub(super) input_ns: u64,
}

/// State of the reasons to be slow.
#[derive(Clone, Copy, Debug)]
pub(super) struct Reduced {
    share: f64,
    why: u32,
    deadlines_ns: u64,
    jumps: Jumps,
}

impl Default for Reduced {
    fn default() -> Self {
        Self { share: 1.0, why: 0, deadlines_ns: 0, jumps: Jumps::default() }
    }
}

/// Returns 1 up to the age `from_ns`, then a value that falls linearly to 0 at `to_ns`.
fn ramp(age_ns: u64, from_ns: u64, to_ns: u64) -> f64 {
    let left = to_ns.saturating_sub(age_ns) as f64 / to_ns.saturating_sub(from_ns).max(1) as f64;
    left.min(1.0)
}

impl Reduced {
    /// Share of the speed that this tick allows, 0 to 1, and the reasons if it is not 1 (bits of
    /// `reduced_flag`). It falls at once and rises slowly. Call exactly once a tick.
    pub(super) fn judge(&mut self, config: &Config, ages: Ages, input: &Input) -> (f64, u32) {
        let charged = charged_ns(input.own_gap_ns);
        self.deadlines_ns = if input.deadlines_missed >= config.deadlines_missed_slow {
            AFTER_DEADLINES_NS
        } else {
            self.deadlines_ns.saturating_sub(charged)
        };
        let far_behind = self.jumps.behind_ns > config.target_jump_slow_ns;
        let reasons = [
            (reduced_flag::INPUT_LATE, ramp(ages.input_ns, config.input_late_ns, config.input_stale_ns)),
            (reduced_flag::TARGET_LATE, ramp(ages.target_ns, config.target_late_ns, config.target_stale_ns)),
            (reduced_flag::TARGET_JUMPED, if far_behind { SLOW } else { 1.0 }),
            (reduced_flag::DEADLINES_LATE, if self.deadlines_ns > 0 { SLOW } else { 1.0 }),
        ];
        let (mut share, mut why) = (1.0_f64, 0);
        for (flag, allowed) in reasons {
            share = share.min(allowed);
            why |= if allowed < 1.0 { flag } else { 0 };
        }
        let risen = self.share + charged as f64 / RISE_NS;
        if share > risen {
            // While the share rises, the earlier reasons stay.
            (share, why) = (risen, why | self.why);
        }
        (self.share, self.why) = (share, why);
        (share, why)
    }

    /// Returns true if nothing reduces the speed.
    pub(super) fn is_full(&self) -> bool {
        self.share >= 1.0
    }

    /// Notes whether the target jumped. Returns true once it has jumped repeatedly for too long.
    pub(super) fn jumps_on(&mut self, config: &Config, input: &Input) -> bool {
        self.jumps.update(config, input, charged_ns(input.own_gap_ns));
        self.jumps.jumping_ns > config.target_jump_hold_ns
    }
}

/// Jumps of the target. A person who moves faster than the robot causes none, however far behind the robot falls.
#[derive(Clone, Copy, Debug, Default)]
struct Jumps {
    jumped: bool,
    /// Time for which the command has been far from a target that had jumped.
    behind_ns: u64,
    since_last_ns: u64,
    /// Time for which jumps have been following each other.
    jumping_ns: u64,
}

impl Jumps {
    fn update(&mut self, config: &Config, input: &Input, charged_ns: u64) {
        let jumps = input.target.jumped;
        // `motion.behind` is of the previous tick, so it says nothing about a jump at this tick. A target
        // that goes on without a jump is the person, even one so fast that the robot never catches up.
        let doubtful = self.since_last_ns <= config.target_jump_hold_ns;
        let behind = jumps || self.jumped && doubtful && input.motion.behind;
        self.behind_ns = if behind { self.behind_ns.saturating_add(charged_ns) } else { 0 };
        self.since_last_ns = if jumps { 0 } else { self.since_last_ns.saturating_add(charged_ns) };
        let goes_on = jumps || self.jumping_ns > 0 && self.since_last_ns <= JUMPS_APART_NS;
        self.jumping_ns = if goes_on { self.jumping_ns.saturating_add(charged_ns) } else { 0 };
        self.jumped = behind;
    }
}

/// Number of parts of a second over which late ticks are counted.
const PARTS: usize = 10;
/// Ticks in each part.
const PART_TICKS: u64 = TICK_HZ / PARTS as u64;

/// Counts how often this process was late within the last second. The second is rounded up by at most a tenth.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Lateness {
    counts: [u32; PARTS],
    /// The part that is counted now.
    part: u64,
}

impl Lateness {
    /// Notes tick `k`. Returns the number of late ticks within the last second.
    pub(super) fn update(&mut self, k: u64, late: bool) -> u32 {
        let part = k / PART_TICKS;
        // A gap of a second or more clears every part.
        for passed in 1..=part.saturating_sub(self.part).min(PARTS as u64) {
            self.counts[((self.part + passed) % PARTS as u64) as usize] = 0;
        }
        self.part = self.part.max(part);
        let now = &mut self.counts[(self.part % PARTS as u64) as usize];
        *now = now.saturating_add(u32::from(late));
        self.counts.iter().fold(0, |sum, count| sum.saturating_add(*count))
    }
}
