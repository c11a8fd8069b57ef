//! Checks the clearance of a command and of its whole stop, by the gate's own kinematics.
//!
//! A new motion is judged at the command and at [`SAMPLES`] instants of its stop. The last instant is the end
//! of the stop. The instants are whole ticks, evenly spread. The positions there are those that the stored
//! plan would play, to the unit.
//!
//! At each of them, the command included, every pair must keep the least clearance. Besides, it must keep
//! what the robot's interface may take from the pair there (see `interface`). The slack is the same
//! everywhere: it covers only the rounding of the distances.
//!
//! # Pairs that need no samples
//!
//! While the stop is played, joint k is never farther than D_k from its command. D_k comes from the extremes
//! of the stop, which the check of the limits has found. By the levers R_k (see `body`), a pair's distance is
//! never less than at the command by more than sum_k R_k D_k. Let u_k be the most that the interface may add
//! to joint k on the way. Then
//!
//! ```text
//! distance at the command - sum_k R_k (D_k + u_k) >= least
//! ```
//!
//! proves the pair for the whole way, at the samples and between them. A lower bound of the distance is enough. So most
//! pairs are proved by what is `known` of them, or by the balls around their capsules. Only the other pairs are measured
//! at the samples.
//!
//! A pair measured at one sample may also be proved for another one. The condition is that it cannot lose its
//! spare distance between the two. Then |q_i - q_j| takes the place of D.
//!
//! # Between samples
//!
//! For the pairs that are left, nothing is proved between samples. Let two samples be dt apart, and let a
//! pair's distance change by at most w a second there. Then the pair comes closer than at both samples by at
//! most w dt / 2. If no point of either body is accelerated by more than B, it is also at most B dt^2 / 4,
//! which is twice the sag of a chord.
//!
//! Stops take at most 0.5 s, so dt is at most 50 ms and a tick. The certificate of whole-body control proves
//! what lies between. The samples detect a certificate that is wrong by more than that.

use messages::JOINTS_MAX;
use robot::{CAPSULES_MAX, JointLimits, Model};

use super::body::{Body, JointSet, NO_ROWS, Places, Rows, unplaced};
use super::check::ConfigError;
use super::denial::Denial;
use super::fixed::{Point, UNITS, ticks_long, ticks_of};
use super::interface::{Deviation, Interface};
use super::known::Known;
use super::stop::Stop;
use crate::clearance::Axis;

#[cfg(test)]
#[path = "tests/stop_clearance.rs"]
mod tests;

/// Number of instants at which a stop is judged.
const SAMPLES: usize = 10;
const END: usize = SAMPLES - 1;

/// A sample, and the spans (from, to) of other samples that a measurement there may prove.
type Look = (usize, [[usize; 2]; 2]);

const NO_SPAN: [usize; 2] = [0, 0];

/// The order of the samples. A stop loses its speed evenly. So it has done half of its way at the third
/// sample, and five sixths at the sixth. Therefore the end and the third sample are near most of the others.
const LOOKS: [Look; SAMPLES] = [
    (END, [[5, END], NO_SPAN]),
    (2, [[0, 2], [3, 5]]),
    (0, [[1, 2], NO_SPAN]),
    (1, [NO_SPAN; 2]),
    (3, [[4, 5], NO_SPAN]),
    (4, [NO_SPAN; 2]),
    (5, [[6, END], NO_SPAN]),
    (6, [[7, END], NO_SPAN]),
    (7, [NO_SPAN; 2]),
    (8, [NO_SPAN; 2]),
];

/// Largest number of pairs: all pairs of 64 capsules, and those of 64 capsules with 16 obstacles.
const PAIRS_MAX: usize = CAPSULES_MAX * (CAPSULES_MAX - 1) / 2 + CAPSULES_MAX * 16;

/// Distance that a pair must have to spare beyond its possible loss, to be proved, m. It is far above the
/// rounding of the kinematics.
const PROVED_M: f64 = 1e-9;

const ALL: JointSet = (1 << JOINTS_MAX) - 1;

/// Geometry and interface of one robot.
#[derive(Clone, Debug)]
pub(super) struct StopClearance {
    pub(super) body: Body,
    deviation: Option<Deviation>,
    /// False if every pair is looked at, for a test that compares the verdicts.
    pub(super) uses_known: bool,
}

/// A pair that is not proved, with the samples that are still to be judged.
#[derive(Clone, Copy, Debug, Default)]
struct Open {
    pair: u16,
    samples: u16,
}

/// Requirements that a motion must keep.
#[derive(Clone, Copy, Debug)]
pub(super) struct Requirement {
    /// Least clearance, m.
    pub(super) least_m: f64,
    /// If true, the pair must also keep what the interface may take.
    pub(super) interface: bool,
}

/// The bodies at one posture.
#[derive(Clone, Debug)]
struct Posed {
    places: Places,
    axes: [Axis; CAPSULES_MAX],
    /// The capsules whose axes are computed.
    ready: u64,
}

/// Working memory, allocated once.
#[derive(Clone, Debug)]
pub(super) struct Memory {
    /// A pair that may be the nearest one.
    hint: usize,
    known: Known,
    posed: Posed,
    open: [Open; PAIRS_MAX],
    moved: [Rows; 2],
}

impl Memory {
    pub(super) fn new() -> Box<Self> {
        let posed = Posed { places: unplaced(), axes: [Axis::default(); CAPSULES_MAX], ready: 0 };
        let (known, open) = (Known::nothing(PAIRS_MAX), [Open::default(); PAIRS_MAX]);
        Box::new(Self { hint: 0, known, posed, open, moved: [NO_ROWS; 2] })
    }
}

/// The pair with the least kept distance: this distance (m), and the pair.
type Worst = (f64, usize);

impl StopClearance {
    pub(super) fn new(
        model: &Model,
        interface: &Interface,
        limits: &[JointLimits; JOINTS_MAX],
    ) -> Result<Self, ConfigError> {
        let body = Body::new(model);
        let value = body.pair_count();
        if value > PAIRS_MAX || body.capsule_count() > CAPSULES_MAX {
            return Err(ConfigError::Pairs { value, bound: PAIRS_MAX });
        }
        Ok(Self { body, deviation: Deviation::new(interface, limits)?, uses_known: true })
    }

    /// Least distance over all pairs at `q` (rad, m), m.
    pub(super) fn clearance_m(&self, q: &[f64; JOINTS_MAX]) -> f64 {
        let posed = Posed::new(&self.body, q);
        let mut least = f64::INFINITY;
        for pair in 0..self.body.pair_count() {
            if self.body.at_most(pair, &posed.axes) < least {
                least = least.min(self.body.distance(pair, &posed.axes));
            }
        }
        least
    }

    /// Checks that every pair keeps the requirements at the command `next` and on the way of `stops`. Returns
    /// the clearance at the command.
    ///
    /// The pair in `memory` that was nearest is measured first. It changes the result only if two pairs have exactly the
    /// same distance: then it decides which one is named.
    pub(super) fn judge(
        &self,
        next: &[Point; JOINTS_MAX],
        stops: &[Stop; JOINTS_MAX],
        required: Requirement,
        memory: &mut Memory,
    ) -> Result<f64, Denial> {
        let (clearance_m, count) = self.at_command(next, stops, required, memory)?;
        if count > 0 {
            self.on_the_way(stops, required, memory, count)?;
        }
        Ok(clearance_m)
    }

    fn deviation(&self, required: Requirement) -> Option<&Deviation> {
        self.deviation.as_ref().filter(|_| required.interface)
    }

    /// Largest distance of joint `j` from its position, rad or m, if it moves by `travel` units and its
    /// interface adds to that.
    fn travel(&self, required: Requirement, stop: &Stop, j: usize, travel: i64) -> f64 {
        let added = |deviation: &Deviation| deviation.most(j, stop.v as f64 / UNITS, stop.a as f64 / UNITS);
        travel as f64 / UNITS + self.deviation(required).map_or(0.0, added)
    }

    /// Distance that a pair keeps, m, of its `distance_m` while the joints are at `x`.
    fn kept(&self, required: Requirement, pair: usize, x: &[Point; JOINTS_MAX], distance_m: f64) -> f64 {
        distance_m - self.deviation(required).map_or(0.0, |deviation| deviation.loss_m(&self.body, pair, x))
    }

    /// Judges the command. Returns its clearance and the number of pairs that it leaves open. They are listed
    /// in the memory.
    fn at_command(
        &self,
        next: &[Point; JOINTS_MAX],
        stops: &[Stop; JOINTS_MAX],
        required: Requirement,
        memory: &mut Memory,
    ) -> Result<(f64, usize), Denial> {
        let (body, Memory { hint, known, posed, open, moved: [moved, _], .. }) = (&self.body, memory);
        posed.pose(body, &positions(next), ALL);
        known.go(body, next);
        *moved = NO_ROWS;
        body.move_by(&std::array::from_fn(|j| self.travel(required, &stops[j], j, stops[j].travel())), moved);
        let mut least = f64::INFINITY;
        if *hint < body.pair_count() {
            least = posed.distance(body, *hint);
        }
        let (mut worst, mut count): (Worst, _) = ((f64::INFINITY, 0), 0);
        for pair in 0..body.pair_count() {
            let needed = body.change(pair, moved) + required.least_m + PROVED_M;
            let bound = known.bound_m(body, pair);
            if self.uses_known && bound >= needed && bound > least {
                continue;
            }
            posed.make_ready(body, body.needed(pair).1);
            let at_most = body.at_most(pair, &posed.axes);
            if at_most >= needed && at_most >= least {
                known.set(body, pair, at_most);
                continue;
            }
            let distance_m = body.distance(pair, &posed.axes);
            known.set(body, pair, distance_m);
            if distance_m <= least {
                (least, *hint) = (distance_m, pair);
            }
            if distance_m >= needed {
                continue;
            }
            worst = lesser(worst, (self.kept(required, pair, next, distance_m), pair));
            open[count] = Open { pair: pair as u16, samples: (1 << SAMPLES) - 1 };
            count += 1;
        }
        if worst.0 >= required.least_m {
            return Ok((least, count));
        }
        Err(Denial::ClearanceAtCommand { pair: body.named(worst.1) })
    }

    /// Judges the open pairs at the samples.
    fn on_the_way(
        &self,
        stops: &[Stop; JOINTS_MAX],
        required: Requirement,
        memory: &mut Memory,
        count: usize,
    ) -> Result<(), Denial> {
        let Memory { posed, open, moved, .. } = memory;
        let open = &mut open[..count];
        let times = sample_times(stops);
        // The other joints lie between no open pair.
        let moving = open.iter().fold(0, |joints, open| joints | self.body.needed(usize::from(open.pair)).0);
        let at = |j: usize, time| if moving & 1 << j != 0 { stops[j].at(time) } else { Point::default() };
        let samples: [[Point; JOINTS_MAX]; SAMPLES] = times.map(|time| std::array::from_fn(|j| at(j, time)));
        for (sample, spans) in LOOKS {
            let at = |open: &&mut Open| open.samples & 1 << sample != 0;
            let (joints, capsules) = open.iter_mut().filter(at).fold((0, 0), |(joints, capsules), open| {
                let (more_joints, more_capsules) = self.body.needed(usize::from(open.pair));
                (joints | more_joints, capsules | more_capsules)
            });
            if capsules == 0 {
                continue;
            }
            for (span, moved) in spans.into_iter().zip(&mut *moved) {
                self.set_moved(required, stops, &samples, sample, span, moved);
            }
            posed.pose(&self.body, &positions(&samples[sample]), joints);
            posed.make_ready(&self.body, capsules);
            let mut worst = (f64::INFINITY, 0);
            for open in open.iter_mut().filter(at) {
                let (pair, kept) = self.look(required, &samples[sample], posed, open, (sample, spans), moved);
                worst = lesser(worst, (kept, pair));
            }
            if worst.0 < required.least_m {
                let pair = self.body.named(worst.1);
                return Err(if sample == END {
                    Denial::ClearanceAtRest { pair }
                } else {
                    Denial::ClearanceOnTheWay { pair }
                });
            }
        }
        Ok(())
    }

    /// Sets the largest displacement of each body between a sample and those of a span.
    fn set_moved(
        &self,
        required: Requirement,
        stops: &[Stop; JOINTS_MAX],
        samples: &[[Point; JOINTS_MAX]; SAMPLES],
        sample: usize,
        [from, to]: [usize; 2],
        moved: &mut Rows,
    ) {
        if from < to {
            let farthest = |j: usize| {
                let away = |other: &[Point; JOINTS_MAX]| (other[j].q - samples[sample][j].q).abs();
                self.travel(required, &stops[j], j, samples[from..to].iter().map(away).max().unwrap_or(0))
            };
            *moved = NO_ROWS;
            self.body.move_by(&std::array::from_fn(farthest), moved);
        }
    }

    /// Measures one pair at a sample, and closes this sample and the spans that the measurement proves.
    /// Returns the pair, and the distance that it keeps or a lower bound of it, m.
    fn look(
        &self,
        required: Requirement,
        x: &[Point; JOINTS_MAX],
        posed: &Posed,
        open: &mut Open,
        (sample, spans): Look,
        moved: &[Rows; 2],
    ) -> (usize, f64) {
        let pair = usize::from(open.pair);
        open.samples &= !(1 << sample);
        let (mut distance_m, mut exact) = (self.body.at_most(pair, &posed.axes), false);
        for ([from, to], moved) in spans.into_iter().zip(moved) {
            let span = (1 << to) - (1 << from);
            if open.samples & span == 0 {
                continue;
            }
            let needed = required.least_m + PROVED_M + self.body.change(pair, moved);
            if distance_m < needed && !exact {
                (distance_m, exact) = (self.body.distance(pair, &posed.axes), true);
            }
            if distance_m >= needed {
                open.samples &= !span;
            }
        }
        let mut kept = self.kept(required, pair, x, distance_m);
        if kept < required.least_m && !exact {
            kept = self.kept(required, pair, x, self.body.distance(pair, &posed.axes));
        }
        (pair, kept)
    }
}

impl Posed {
    fn new(body: &Body, q: &[f64; JOINTS_MAX]) -> Self {
        let mut posed = Self { places: unplaced(), axes: [Axis::default(); CAPSULES_MAX], ready: 0 };
        posed.pose(body, q, ALL);
        posed.make_ready(body, u64::MAX);
        posed
    }

    /// Places the bodies that `joints` move.
    fn pose(&mut self, body: &Body, q: &[f64; JOINTS_MAX], joints: JointSet) {
        body.place(q, joints, &mut self.places);
        self.ready = 0;
    }

    /// Places those of the `capsules` that are not placed yet.
    #[inline]
    fn make_ready(&mut self, body: &Body, capsules: u64) {
        let mut left = capsules & !self.ready;
        self.ready |= capsules;
        while left != 0 {
            let i = left.trailing_zeros() as usize;
            left &= left - 1;
            if i < body.capsule_count() {
                self.axes[i] = body.axis(i, &self.places);
            }
        }
    }

    fn distance(&mut self, body: &Body, pair: usize) -> f64 {
        self.make_ready(body, body.needed(pair).1);
        body.distance(pair, &self.axes)
    }
}

/// Returns the lesser one. NaN is taken and stays, because no distance is less than NaN, and NaN is not at
/// least any distance.
fn lesser(worst: Worst, other: Worst) -> Worst {
    if other.0 < worst.0 || other.0.is_nan() { other } else { worst }
}

pub(super) fn positions(points: &[Point; JOINTS_MAX]) -> [f64; JOINTS_MAX] {
    points.map(|point| point.q as f64 / UNITS)
}

/// Times of the samples, in units of time from the command. They are whole ticks. The last one is the first
/// tick at which all joints rest.
pub(super) fn sample_times(stops: &[Stop; JOINTS_MAX]) -> [i64; SAMPLES] {
    let longest = stops.iter().map(Stop::duration).max().unwrap_or(0);
    let ticks = ticks_of(longest);
    std::array::from_fn(|i| ticks_long((ticks * (i as u64 + 1)).div_ceil(SAMPLES as u64)))
}
