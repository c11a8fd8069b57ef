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
//! pairs are proved by the balls around their capsules. Only the other pairs are measured at the samples.
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

use super::body::{Body, JointSet, Moved, Places, unplaced};
use super::check::ConfigError;
use super::denial::Denial;
use super::fixed::{Point, UNITS, ticks_long, ticks_of};
use super::interface::{Deviation, Interface};
use super::stop::Stop;
use crate::clearance::Axis;

#[cfg(test)]
#[path = "tests/way.rs"]
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
pub(super) struct Ways {
    pub(super) body: Body,
    deviation: Option<Deviation>,
}

/// A pair that is not proved, with the samples that are still to be judged.
#[derive(Clone, Copy, Debug, Default)]
struct Open {
    pair: u16,
    samples: u16,
}

/// Requirements that a motion must keep.
#[derive(Clone, Copy, Debug)]
pub(super) struct Asked {
    /// Least clearance, m.
    pub(super) least_m: f64,
    /// If true, the pair must also keep what the interface may take.
    pub(super) interface: bool,
}

/// The bodies at one posture.
struct Posed {
    places: Places,
    axes: [Axis; CAPSULES_MAX],
}

/// The pair with the least kept distance: this distance (m), and the pair.
type Worst = (f64, usize);

impl Ways {
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
        Ok(Self { body, deviation: Deviation::new(interface, limits)? })
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
    /// `hint` is a pair that may be the nearest one, and is set to the nearest one. It saves time. It changes
    /// the result only if two pairs have exactly the same distance: then it decides which one is named.
    pub(super) fn judge(
        &self,
        next: &[Point; JOINTS_MAX],
        stops: &[Stop; JOINTS_MAX],
        asked: Asked,
        hint: &mut usize,
    ) -> Result<f64, Denial> {
        let mut open = [Open::default(); PAIRS_MAX];
        let (clearance_m, count) = self.at_command(next, stops, asked, hint, &mut open)?;
        if count > 0 {
            self.on_the_way(stops, asked, &mut open[..count])?;
        }
        Ok(clearance_m)
    }

    fn deviation(&self, asked: Asked) -> Option<&Deviation> {
        self.deviation.as_ref().filter(|_| asked.interface)
    }

    /// Largest distance of joint `j` from its position, rad or m, if it moves by `travel` units and its
    /// interface adds to that.
    fn travel(&self, asked: Asked, stop: &Stop, j: usize, travel: i64) -> f64 {
        let added = |deviation: &Deviation| deviation.most(j, stop.v as f64 / UNITS, stop.a as f64 / UNITS);
        travel as f64 / UNITS + self.deviation(asked).map_or(0.0, added)
    }

    /// Distance that a pair keeps, m, of its `distance_m` while the joints are at `x`.
    fn kept(&self, asked: Asked, pair: usize, x: &[Point; JOINTS_MAX], distance_m: f64) -> f64 {
        distance_m - self.deviation(asked).map_or(0.0, |deviation| deviation.loss_m(&self.body, pair, x))
    }

    /// Judges the command. Returns its clearance and the number of pairs that it leaves open. They are listed
    /// in `open`.
    fn at_command(
        &self,
        next: &[Point; JOINTS_MAX],
        stops: &[Stop; JOINTS_MAX],
        asked: Asked,
        hint: &mut usize,
        open: &mut [Open; PAIRS_MAX],
    ) -> Result<(f64, usize), Denial> {
        let body = &self.body;
        let posed = Posed::new(body, &positions(next));
        let moved = body.moved(&std::array::from_fn(|j| self.travel(asked, &stops[j], j, stops[j].travel())));
        let mut least = f64::INFINITY;
        if *hint < body.pair_count() {
            least = body.distance(*hint, &posed.axes);
        }
        let (mut worst, mut count): (Worst, _) = ((f64::INFINITY, 0), 0);
        for pair in 0..body.pair_count() {
            let (at_most, needed) = (body.at_most(pair, &posed.axes), body.change(pair, &moved) + asked.least_m);
            if at_most >= needed + PROVED_M && at_most >= least {
                continue;
            }
            let distance_m = body.distance(pair, &posed.axes);
            if distance_m <= least {
                (least, *hint) = (distance_m, pair);
            }
            if distance_m >= needed + PROVED_M {
                continue;
            }
            worst = lesser(worst, (self.kept(asked, pair, next, distance_m), pair));
            open[count] = Open { pair: pair as u16, samples: (1 << SAMPLES) - 1 };
            count += 1;
        }
        if worst.0 >= asked.least_m {
            return Ok((least, count));
        }
        Err(Denial::ClearanceAtCommand { pair: body.named(worst.1) })
    }

    /// Judges the open pairs at the samples.
    fn on_the_way(&self, stops: &[Stop; JOINTS_MAX], asked: Asked, open: &mut [Open]) -> Result<(), Denial> {
        let times = sample_times(stops);
        let samples: [[Point; JOINTS_MAX]; SAMPLES] =
            std::array::from_fn(|i| std::array::from_fn(|j| stops[j].at(times[i])));
        let mut posed = Posed { places: unplaced(), axes: [Axis::default(); CAPSULES_MAX] };
        for (sample, spans) in LOOKS {
            let at = |open: &&mut Open| open.samples & 1 << sample != 0;
            let (joints, capsules) = open.iter_mut().filter(at).fold((0, 0), |(joints, capsules), open| {
                let (more_joints, more_capsules) = self.body.needed(usize::from(open.pair));
                (joints | more_joints, capsules | more_capsules)
            });
            if capsules == 0 {
                continue;
            }
            posed.pose(&self.body, &positions(&samples[sample]), joints, capsules);
            let moved = spans.map(|span| self.moved_in(asked, stops, &samples, sample, span));
            let mut worst = (f64::INFINITY, 0);
            for open in open.iter_mut().filter(at) {
                let (pair, kept) = self.look(asked, &samples[sample], &posed, open, (sample, spans), &moved);
                worst = lesser(worst, (kept, pair));
            }
            if worst.0 < asked.least_m {
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

    /// Largest displacement of each capsule between a sample and those of a span. None if the span is empty.
    fn moved_in(
        &self,
        asked: Asked,
        stops: &[Stop; JOINTS_MAX],
        samples: &[[Point; JOINTS_MAX]; SAMPLES],
        sample: usize,
        [from, to]: [usize; 2],
    ) -> Option<Moved> {
        let farthest = |j: usize| {
            let away = |other: &[Point; JOINTS_MAX]| (other[j].q - samples[sample][j].q).abs();
            self.travel(asked, &stops[j], j, samples[from..to].iter().map(away).max().unwrap_or(0))
        };
        (from < to).then(|| self.body.moved(&std::array::from_fn(farthest)))
    }

    /// Measures one pair at a sample, and closes this sample and the spans that the measurement proves.
    /// Returns the pair, and the distance that it keeps or a lower bound of it, m.
    fn look(
        &self,
        asked: Asked,
        x: &[Point; JOINTS_MAX],
        posed: &Posed,
        open: &mut Open,
        (sample, spans): Look,
        moved: &[Option<Moved>; 2],
    ) -> (usize, f64) {
        let pair = usize::from(open.pair);
        open.samples &= !(1 << sample);
        let (mut distance_m, mut exact) = (self.body.at_most(pair, &posed.axes), false);
        for ([from, to], moved) in spans.into_iter().zip(moved) {
            let span = (1 << to) - (1 << from);
            let Some(moved) = moved.as_ref().filter(|_| open.samples & span != 0) else { continue };
            let needed = asked.least_m + PROVED_M + self.body.change(pair, moved);
            if distance_m < needed && !exact {
                (distance_m, exact) = (self.body.distance(pair, &posed.axes), true);
            }
            if distance_m >= needed {
                open.samples &= !span;
            }
        }
        let mut kept = self.kept(asked, pair, x, distance_m);
        if kept < asked.least_m && !exact {
            kept = self.kept(asked, pair, x, self.body.distance(pair, &posed.axes));
        }
        (pair, kept)
    }
}

impl Posed {
    fn new(body: &Body, q: &[f64; JOINTS_MAX]) -> Self {
        let mut posed = Self { places: unplaced(), axes: [Axis::default(); CAPSULES_MAX] };
        posed.pose(body, q, ALL, u64::MAX);
        posed
    }

    /// Places the bodies that `joints` move, and the capsules of the set `capsules`.
    fn pose(&mut self, body: &Body, q: &[f64; JOINTS_MAX], joints: JointSet, capsules: u64) {
        body.place(q, joints, &mut self.places);
        for i in (0..body.capsule_count()).filter(|i| capsules & 1 << i != 0) {
            self.axes[i] = body.axis(i, &self.places);
        }
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
