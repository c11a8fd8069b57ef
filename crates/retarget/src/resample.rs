//! Resamples skeletons of 30 to 240 Hz, early, late or in bursts, to a continuous person at every tick.
//!
//! Glossary: *source time* is the time of a skeleton on our monotonic clock, with the jitter of its delivery
//! smoothed away. A *knot* is one skeleton of one arm at its source time. The *playhead* is the source time that
//! is shown now. It follows now - delay, and never runs backwards or beyond the newest knot. It catches up at one
//! and a half times its speed at most. A *restart* (first skeleton, a new writer, silence) moves the playhead
//! freely, and a crossfade hides the move.

use messages::{Service, Skeleton, Stamp, comes_after};
use nalgebra::UnitQuaternion;

use crate::arm::ArmQ;
use crate::extrapolation::{Extrapolation, RATE_OVER_NS};
use crate::network::{Latent, interpolate_latent};
use crate::prediction::{AGES_S, Turns};
use crate::smoothstep::smoothstep;
use robot::Limbs;
use robot::limbs::{align, slerp};

/// Silence after which the input is stale and the next skeleton is a restart, ns. It is that of the service table.
pub const STALE_NS: u64 = Service::Skeleton.row().stale_after_ms as u64 * 1_000_000;
/// Longest delay, ns: commercial teleoperation lies between 100 and 250 ms.
pub const DELAY_MAX_NS: u64 = 250_000_000;
/// Knots kept per arm. A prediction looks back half a second, which is 120 knots at 240 Hz, and one on either
/// side, rounded up.
const KNOTS: usize = 128;
/// Largest number of skeletons that a sequence counts as one step: a quarter of a second at 240 Hz.
const SKIPPED_MAX: u64 = 64;
/// Time for which an arm must have been seen before it is predicted, ns. It covers three frames of the slowest
/// source, and much of the prediction's input.
const PREDICTED_FROM_NS: i64 = 200_000_000;
/// Crossfade after a restart, ns. A quarter of a second is about the time that people take to notice and react.
/// Even half a turn of a limb stays below 20 rad/s. Joints may turn faster where the arm leaves its reachable
/// range. The limits of whole-body control apply on top.
const BLEND_NS: i64 = 250_000_000;
/// Bounds of the playhead's speed, relative to real time: half and one and a half. Catching up after a late
/// skeleton then looks like a person who hurries, not like a jump.
const SPEED: (f64, f64) = (0.5, 1.5);
/// Time constant of the playhead's error, ns. It is slower than a period at 30 Hz, so jitter is not followed.
const CATCH_UP_NS: f64 = 50e6;
/// Share of a skeleton's timing error that its source time corrects: 1/16 smooths over half a second at 30 Hz.
const TIMING_GAIN: f64 = 1.0 / 16.0;
/// Largest share by which a step of source time is shortened. Motion then is at most a third faster.
const TIMING_STEP_MAX: f64 = 0.25;
/// Skeletons over which the period is averaged. A burst of four moves it by an eighth at most.
const PERIOD_COUNT_MAX: u32 = 32;
/// Shortest mean period that is used, ns: 240 Hz is the fastest source.
const PERIOD_MIN_NS: f64 = 1e9 / 240.0;
/// Shortest step of source time, ns, for stamps that do not advance: a source of 1 kHz, four times the fastest allowed.
const STEP_MIN_NS: i64 = 1_000_000;

/// Signed nanoseconds of a stamp, limited to 146 years.
fn ns(stamp: Stamp) -> i64 {
    stamp.0.min(i64::MAX as u64 / 2) as i64
}

/// Identity and times of one skeleton.
#[derive(Clone, Copy, Debug)]
struct Arrival {
    incarnation: u32,
    session_nonce: u64,
    operator_id: u32,
    sequence: u64,
    received: i64,
    origin: i64,
    source: i64,
}

/// Mean time between skeletons: mean time between arrivals over mean count of skeletons between them.
#[derive(Clone, Copy, Debug, Default)]
struct MeanPeriod {
    between_ns: f64,
    count: f64,
    arrivals: u32,
}

impl MeanPeriod {
    /// Adds the time and the number of skeletons since the last arrival. Returns the mean period, ns.
    fn add(&mut self, between_ns: f64, count: f64) -> f64 {
        self.arrivals = (self.arrivals + 1).min(PERIOD_COUNT_MAX);
        self.between_ns += (between_ns - self.between_ns) / f64::from(self.arrivals);
        self.count += (count - self.count) / f64::from(self.arrivals);
        (self.between_ns / self.count).max(PERIOD_MIN_NS)
    }
}

/// Maps skeletons to source time and moves the playhead.
#[derive(Clone, Copy, Debug, Default)]
pub struct SourceClock {
    newest: Option<Arrival>,
    mean: MeanPeriod,
    playhead: i64,
    ticked: i64,
    restarted: bool,
}

/// Place of a new skeleton in source time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Placed {
    /// Source time, ns. It is later than that of every skeleton since the last restart.
    pub source: i64,
    /// True if no earlier skeleton continues into this one.
    pub restart: bool,
    /// Source time that was shown last, ns.
    pub playhead: i64,
}

impl SourceClock {
    /// Places a skeleton that was received at `received` in source time. `None` if it was seen before or is out of
    /// order.
    pub fn place(&mut self, skeleton: &Skeleton, received: Stamp) -> Option<Placed> {
        let mut arrival = Arrival {
            incarnation: skeleton.header.incarnation,
            session_nonce: skeleton.session_nonce,
            operator_id: skeleton.operator_id,
            sequence: skeleton.header.sequence,
            received: ns(received),
            origin: ns(skeleton.header.origin),
            source: ns(received),
        };
        let same = self.newest.filter(|last| last.incarnation == arrival.incarnation);
        if same.is_some_and(|last| !comes_after(arrival.sequence, last.sequence)) {
            return None;
        }
        let continues = same.filter(|last| {
            let person = last.session_nonce == arrival.session_nonce && last.operator_id == arrival.operator_id;
            person && arrival.received - last.received <= STALE_NS as i64
        });
        let source = continues.and_then(|last| self.source_after(&last, &arrival));
        match source {
            Some(source) => arrival.source = source,
            None => {
                self.mean = MeanPeriod::default();
                self.restarted = true;
            }
        }
        self.newest = Some(arrival);
        Some(Placed { source: arrival.source, restart: source.is_none(), playhead: self.playhead })
    }

    /// Source time of the next skeleton: one step after the last one, pulled toward its arrival. The step is that
    /// of the client's stamps if they are plausible. Else it is the mean period times the skeletons that the
    /// sequence counts. `None` if neither fits the arrival: then it is a restart.
    fn source_after(&mut self, last: &Arrival, next: &Arrival) -> Option<i64> {
        let count = next.sequence.wrapping_sub(last.sequence).clamp(1, SKIPPED_MAX) as f64;
        let by_mean = count * self.mean.add((next.received - last.received).max(0) as f64, count);
        let by_origin = (next.origin - last.origin) as f64;
        let arrived = (next.received - last.source) as f64;
        let fits = |step: f64| (arrived - step).abs() <= STALE_NS as f64;
        // If the client's clock runs at another speed than ours, its stamps soon no longer fit.
        let stamped = last.origin > 0 && by_origin > 0.0 && by_origin <= STALE_NS as f64 && fits(by_origin);
        let step = if stamped { by_origin } else { by_mean }.max(STEP_MIN_NS as f64);
        let correction = ((arrived - step) * TIMING_GAIN).max(-TIMING_STEP_MAX * step);
        fits(step).then_some(last.source + ((step + correction) as i64).max(STEP_MIN_NS))
    }

    /// Moves the playhead to `now` and returns it, ns of source time.
    pub fn advance(&mut self, now: Stamp, delay_ns: u64) -> i64 {
        let now = ns(now);
        let target = now - delay_ns as i64;
        let elapsed = (now - self.ticked).max(0);
        if self.restarted {
            self.playhead = target;
            self.restarted = false;
        } else {
            let error = (target - self.playhead - elapsed) as f64;
            let speed = (1.0 + error / CATCH_UP_NS).clamp(SPEED.0, SPEED.1);
            self.playhead += (elapsed as f64 * speed) as i64;
        }
        self.ticked = now;
        // The person is not known beyond the newest skeleton. A restart may begin before its first knot.
        self.playhead = self.playhead.min(self.newest.map_or(i64::MAX, |newest| newest.source));
        self.playhead
    }
}

/// One arm of the person at one instant: the point of the latent space and its limb rotations.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// Q_h of the limbs. Zero without a network.
    pub latent: Latent,
    /// Limb rotations of a left (or mirrored right) arm.
    pub limbs: Limbs,
    /// Rotation of its hand, in the same way. `None` if the person's is not known.
    pub hand: Option<UnitQuaternion<f64>>,
    /// Closure of its hand, from 0 (open) to 1 (closed). `None` if the person's is not known.
    pub closure: Option<f64>,
    /// Posture that brings its hand to where the person's touches, rad, and the share of this from 0 to 1. `None` far from
    /// everything.
    pub touching: Option<(ArmQ, f64)>,
}

impl Sample {
    fn between(&self, other: &Self, s: f64) -> Self {
        Self {
            latent: interpolate_latent(&self.latent, &other.latent, s),
            limbs: self.limbs.between(&other.limbs, s),
            // A hand that comes or goes is shown as it is known.
            hand: self.hand.zip(other.hand).map(|(hand, other)| slerp(&hand, &other, s)).or(self.hand).or(other.hand),
            closure: self.closure.zip(other.closure).map(|(from, to)| from + (to - from) * s).or(other.closure),
            touching: match (self.touching, other.touching) {
                (Some(from), Some(to)) => {
                    let q = std::array::from_fn(|j| from.0[j] + (to.0[j] - from.0[j]) * s);
                    Some((q, from.1 + (to.1 - from.1) * s))
                }
                // It comes and goes with the time between the two.
                (Some((q, share)), None) => Some((q, share * (1.0 - s))),
                (None, Some((q, share))) => Some((q, share * s)),
                (None, None) => None,
            },
        }
    }

    fn aligned_to(&self, other: &Self) -> Self {
        let upper = align(&self.limbs.upper, &other.limbs.upper);
        Self { limbs: Limbs { upper, fore: align(&self.limbs.fore, &other.limbs.fore) }, ..*self }
    }
}

#[derive(Clone, Copy, Debug)]
struct Knot {
    source: i64,
    sample: Sample,
}

/// Sample that fades out after a restart.
#[derive(Clone, Copy, Debug)]
struct Fade {
    from: Sample,
    begun: i64,
}

impl Fade {
    /// Returns the share of the new sample at `now`, from 0 to 1.
    fn share(&self, now: Stamp) -> f64 {
        smoothstep((ns(now) - self.begun) as f64, [0.0, BLEND_NS as f64])
    }
}

/// Knots of one arm, and what it shows.
#[derive(Clone, Debug)]
pub struct Track {
    knots: [Knot; KNOTS],
    count: usize,
    newest: usize,
    shown: Option<Sample>,
    fade: Option<Fade>,
    received: Stamp,
    /// Prediction after the newest knot.
    extrapolation: Extrapolation,
}

impl Default for Track {
    fn default() -> Self {
        let limbs = Limbs::identity();
        let knot = Knot {
            source: 0,
            sample: Sample { latent: Latent::default(), limbs, hand: None, closure: None, touching: None },
        };
        let (shown, fade, extrapolation) = (None, None, Extrapolation::default());
        Self { knots: [knot; KNOTS], count: 0, newest: 0, shown, fade, received: Stamp::NONE, extrapolation }
    }
}

impl Track {
    /// Takes a new skeleton's arm, received at `received`. After a restart, or if this arm was not valid for too
    /// long, the shown sample fades into the new one.
    pub fn push(&mut self, placed: Placed, sample: Sample, received: Stamp, now: Stamp) {
        if placed.restart || self.count == 0 || received.since(self.received) > STALE_NS {
            self.count = 0;
            self.fade = self.shown.map(|from| Fade { from: from.aligned_to(&sample), begun: ns(now) });
        }
        if self.count > 0 {
            // If this arm was not valid for some frames, the playhead may have passed the newest knot and hold it.
            // Then the way to the next knot begins where it holds.
            let newest = &mut self.knots[self.newest];
            newest.source = newest.source.max(placed.playhead.min(placed.source - STEP_MIN_NS));
        }
        // Signs follow the previous knot, so that the path on the sphere stays continuous beyond half a turn.
        let sample = if self.count > 0 { sample.aligned_to(&self.knots[self.newest].sample) } else { sample };
        self.newest = (self.newest + 1) % KNOTS;
        self.knots[self.newest] = Knot { source: placed.source, sample };
        self.count = (self.count + 1).min(KNOTS);
        self.received = received;
        let old = self.age_at(placed.source - RATE_OVER_NS);
        let before = (old < self.count).then(|| self.knot(old));
        let before = before.map(|knot| (&knot.sample.limbs, placed.source - knot.source));
        self.extrapolation = Extrapolation::fading(&sample.limbs, before);
    }

    /// Time at which the newest skeleton with this arm was received.
    pub fn received(&self) -> Stamp {
        self.received
    }

    /// Returns true if a skeleton with this arm arrived recently.
    pub fn is_fresh(&self, now: Stamp) -> bool {
        self.count > 0 && now.since(self.received) <= STALE_NS
    }

    /// Returns the arm at source time `playhead`. `None` before its first skeleton.
    pub fn show(&mut self, playhead: i64, now: Stamp) -> Option<Sample> {
        let sample = self.show_ahead(playhead, now)?;
        self.fade = self.fade.filter(|fade| fade.share(now) < 1.0);
        self.shown = Some(sample);
        self.shown
    }

    /// Returns what [`Track::show`] would show at `playhead` and `now`, and shows nothing. It knows nothing beyond the
    /// newest knot.
    pub fn show_ahead(&self, playhead: i64, now: Stamp) -> Option<Sample> {
        let sample = (self.count > 0).then(|| self.at(playhead))?;
        let fade = self.fade.filter(|fade| fade.share(now) < 1.0);
        Some(fade.map_or(sample, |fade| fade.from.between(&sample, fade.share(now))))
    }

    /// Returns the arm at source time `source`, shown at `now`: between the knots, or predicted beyond the newest
    /// one. The flag is true if it was measured. `None` before its first skeleton.
    pub fn ahead(&self, source: i64, now: Stamp) -> Option<(Limbs, bool)> {
        if self.count == 0 {
            return None;
        }
        let newest = self.knot(0);
        let seen = source <= newest.source;
        let limbs = if seen {
            self.limbs_at(source)
        } else {
            self.extrapolation.at(&newest.sample.limbs, source - newest.source)
        };
        // The crossfade of a restart.
        Some((self.fade.map_or(limbs, |fade| fade.from.limbs.between(&limbs, fade.share(now))), seen))
    }

    /// Returns true while the crossfade of a restart lasts.
    pub fn is_fading(&self) -> bool {
        self.fade.is_some()
    }

    /// Sets the prediction after the newest knot, until there is a newer one.
    pub fn extrapolate(&mut self, turns: &Turns) {
        self.extrapolation = Extrapolation::learnt(turns);
    }

    /// Returns true if the arm has been seen for long enough to be predicted.
    pub fn is_predictable(&self) -> bool {
        self.count > 0 && self.knot(0).source - self.knot(self.count - 1).source >= PREDICTED_FROM_NS
    }

    /// Returns the limbs at source time `source`, and at each of `AGES_S` before it. Before the oldest knot and
    /// after the newest one they stand still. `None` before the first skeleton.
    pub fn past(&self, source: i64) -> Option<(Limbs, [Limbs; AGES_S.len()])> {
        let before = |age_s: f64| self.limbs_at(source - (age_s * 1e9) as i64);
        (self.count > 0).then(|| (self.limbs_at(source), AGES_S.map(before)))
    }

    /// Returns the knot that is `age` knots older than the newest one.
    fn knot(&self, age: usize) -> &Knot {
        &self.knots[(self.newest + KNOTS - age) % KNOTS]
    }

    /// Returns the age of the newest knot that is not after `source`, or `count` if there is none. Knots are
    /// always in the order of their arrival.
    fn age_at(&self, source: i64) -> usize {
        let (mut low, mut high) = (0, self.count);
        while low < high {
            let middle = low.midpoint(high);
            if self.knot(middle).source <= source {
                high = middle;
            } else {
                low = middle + 1;
            }
        }
        low
    }

    /// Returns the knots around `source` and the share of the time from the first to the second. Outside of all
    /// knots it returns the nearest one twice.
    fn bracket(&self, source: i64) -> (&Sample, &Sample, f64) {
        let age = self.age_at(source);
        if age == 0 || age == self.count {
            let only = &self.knot(age.min(self.count.saturating_sub(1))).sample;
            return (only, only, 0.0);
        }
        let (knot, later) = (self.knot(age), self.knot(age - 1));
        let span = later.source - knot.source;
        // The binary search skipped all knots that are not after `source`, so the span is not empty.
        (&knot.sample, &later.sample, (source - knot.source) as f64 / span as f64)
    }

    /// Interpolates between the knots around `playhead`. Outside of them it returns the nearest one.
    fn at(&self, playhead: i64) -> Sample {
        let (from, to, share) = self.bracket(playhead);
        if std::ptr::eq(from, to) { *from } else { from.between(to, share) }
    }

    /// As `at`, for the limbs alone.
    fn limbs_at(&self, source: i64) -> Limbs {
        let (from, to, share) = self.bracket(source);
        if std::ptr::eq(from, to) { from.limbs } else { from.limbs.between(&to.limbs, share) }
    }
}
