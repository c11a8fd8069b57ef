//! The clearance of a command and on the whole way of its stop, by the gate's own kinematics.
//!
//! A new motion is judged at the command and at [`SAMPLES`] instants of its stop, the last of which is its end. The instants
//! are whole ticks, evenly spread, and the positions there are those that the stored plan would play, to the unit. At each
//! of them every pair must keep the least clearance, the one of the command too, and beside it what the robot's interface
//! may take from the pair there (see `interface`). The slack is the same everywhere: rounding of the distances alone.
//!
//! # Pairs that need no samples
//!
//! While the stop is played, joint k is nowhere farther than D_k from its command; D_k comes from the extremes of the stop,
//! which the limits' check has found. By the levers R_k (see `body`) no pair loses more than sum_k R_k D_k against the
//! command, at any instant. With u_k the most that the interface may add to joint k on the way,
//!
//! ```text
//! distance at the command - sum_k R_k (D_k + u_k) >= least
//! ```
//!
//! proves the pair for the whole way, samples and all between them. A lower bound of the distance will do, so most pairs
//! are proved by the balls around their capsules. Only the others are measured at the samples. A pair that is measured at
//! one is proved for every other one to which it cannot lose what it has to spare: |q_i - q_j| takes the place of D.
//!
//! # Between samples
//!
//! Nothing is proved of the pairs that are left. Let two samples be dt apart, and let a pair's distance change by at most w
//! a second there. Then the pair comes closer than at both samples by at most w dt / 2. If no point of either body is
//! accelerated by more than B, it is also at most B dt^2 / 4, twice the sag of a chord. Stops take at most 0.5 s, so dt is
//! at most 50 ms and a tick. The certificate of whole-body control proves what lies between. The samples catch a
//! certificate that is wrong by more than that.

use messages::JOINTS;
use robot::{CAPSULES_MAX, JointLimits, Model};

use super::body::{Body, JointSet, Moved, Places, unplaced};
use super::check::ConfigError;
use super::denial::Denial;
use super::fixed::{Point, UNITS, ticks_long, ticks_of};
use super::interface::{Deviation, Interface};
use super::stop::Stop;
use crate::clearance::Axis;

#[cfg(test)]
mod tests;

/// Instants of a stop at which it is judged.
const SAMPLES: usize = 10;
const END: usize = SAMPLES - 1;

/// A sample, and the spans of others (from, to) that what is measured there may prove.
type Look = (usize, [[usize; 2]; 2]);

const NO_SPAN: [usize; 2] = [0, 0];

/// The order of the samples. A stop loses its speed evenly, so it has half of its way behind it at the third sample, and
/// five sixths at the sixth: the end and the third one are near most of the others.
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

/// Pairs that fit: all of 64 capsules, and those of 64 capsules with 16 obstacles.
const PAIRS_MAX: usize = CAPSULES_MAX * (CAPSULES_MAX - 1) / 2 + CAPSULES_MAX * 16;

/// What a pair must have to spare beyond what it may lose, to be proved, m: far above the rounding of the kinematics.
const PROVED_M: f64 = 1e-9;

const ALL: JointSet = (1 << JOINTS) - 1;

/// Geometry and interface of one robot.
#[derive(Clone, Debug)]
pub(super) struct Ways {
    pub(super) body: Body,
    deviation: Option<Deviation>,
}

/// A pair that is not proved, with the samples that are still open.
#[derive(Clone, Copy, Debug, Default)]
struct Open {
    pair: u16,
    samples: u16,
}

/// What a motion has to keep.
#[derive(Clone, Copy, Debug)]
pub(super) struct Asked {
    /// Least clearance, m.
    pub(super) least_m: f64,
    /// Beside it what the interface may take.
    pub(super) interface: bool,
}

/// The bodies at one posture.
struct Posed {
    places: Places,
    axes: [Axis; CAPSULES_MAX],
}

/// The pair that keeps least of what it must: what it keeps (m), and the pair.
type Worst = (f64, usize);

impl Ways {
    pub(super) fn new(
        model: &Model,
        interface: &Interface,
        limits: &[JointLimits; JOINTS],
    ) -> Result<Self, ConfigError> {
        let body = Body::new(model);
        let value = body.pair_count();
        if value > PAIRS_MAX || body.capsule_count() > CAPSULES_MAX {
            return Err(ConfigError::Pairs { value, bound: PAIRS_MAX });
        }
        Ok(Self { body, deviation: Deviation::new(interface, limits)? })
    }

    /// Least distance of all pairs at `q` (rad, m), m.
    pub(super) fn clearance_m(&self, q: &[f64; JOINTS]) -> f64 {
        let posed = Posed::new(&self.body, q);
        let mut least = f64::INFINITY;
        for pair in 0..self.body.pair_count() {
            if self.body.at_most(pair, &posed.axes) < least {
                least = least.min(self.body.distance(pair, &posed.axes));
            }
        }
        least
    }

    /// Whether every pair keeps what is asked at the command `next` and on the way of `stops`: the clearance at the
    /// command. `hint` is a pair that may be the nearest one, and becomes the nearest; it saves time, and changes only
    /// which of two pairs at the very same distance is named.
    pub(super) fn judge(
        &self,
        next: &[Point; JOINTS],
        stops: &[Stop; JOINTS],
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

    /// How far joint `j` may be from where it is, rad or m, if it moves by `travel` units and its interface adds to that.
    fn travel(&self, asked: Asked, stop: &Stop, j: usize, travel: i64) -> f64 {
        let added = |deviation: &Deviation| deviation.most(j, stop.v as f64 / UNITS, stop.a as f64 / UNITS);
        travel as f64 / UNITS + self.deviation(asked).map_or(0.0, added)
    }

    /// What a pair at `distance_m` keeps of it, m, when the joints are at `x`.
    fn kept(&self, asked: Asked, pair: usize, x: &[Point; JOINTS], distance_m: f64) -> f64 {
        distance_m - self.deviation(asked).map_or(0.0, |deviation| deviation.of(&self.body, pair, x))
    }

    /// Judges the command: its clearance, and how many pairs it leaves open, which it lists.
    fn at_command(
        &self,
        next: &[Point; JOINTS],
        stops: &[Stop; JOINTS],
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

    /// Judges the pairs that are open at the samples.
    fn on_the_way(&self, stops: &[Stop; JOINTS], asked: Asked, open: &mut [Open]) -> Result<(), Denial> {
        let times = sample_times(stops);
        let samples: [[Point; JOINTS]; SAMPLES] =
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

    /// How far each capsule may be moved between a sample and those of a span; none for a span of none that is open.
    fn moved_in(
        &self,
        asked: Asked,
        stops: &[Stop; JOINTS],
        samples: &[[Point; JOINTS]; SAMPLES],
        sample: usize,
        [from, to]: [usize; 2],
    ) -> Option<Moved> {
        let farthest = |j: usize| {
            let away = |other: &[Point; JOINTS]| (other[j].q - samples[sample][j].q).abs();
            self.travel(asked, &stops[j], j, samples[from..to].iter().map(away).max().unwrap_or(0))
        };
        (from < to).then(|| self.body.moved(&std::array::from_fn(farthest)))
    }

    /// Measures one pair at a sample, and closes that sample and the spans that it proves: what the pair keeps, m, or at
    /// least that.
    fn look(
        &self,
        asked: Asked,
        x: &[Point; JOINTS],
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
    fn new(body: &Body, q: &[f64; JOINTS]) -> Self {
        let mut posed = Self { places: unplaced(), axes: [Axis::default(); CAPSULES_MAX] };
        posed.pose(body, q, ALL, u64::MAX);
        posed
    }

    /// Places the bodies that `joints` move, and the capsules of the set `capsules`.
    fn pose(&mut self, body: &Body, q: &[f64; JOINTS], joints: JointSet, capsules: u64) {
        body.place(q, joints, &mut self.places);
        for i in (0..body.capsule_count()).filter(|i| capsules & 1 << i != 0) {
            self.axes[i] = body.axis(i, &self.places);
        }
    }
}

/// NaN is taken, and stays: nothing is less than it, and it is at least nothing.
fn lesser(worst: Worst, other: Worst) -> Worst {
    if other.0 < worst.0 || other.0.is_nan() { other } else { worst }
}

pub(super) fn positions(points: &[Point; JOINTS]) -> [f64; JOINTS] {
    points.map(|point| point.q as f64 / UNITS)
}

/// When the samples are, in units of time from the command: whole ticks, the last one the first at which all joints rest.
pub(super) fn sample_times(stops: &[Stop; JOINTS]) -> [i64; SAMPLES] {
    let longest = stops.iter().map(Stop::duration).max().unwrap_or(0);
    let ticks = ticks_of(longest);
    std::array::from_fn(|i| ticks_long((ticks * (i as u64 + 1)).div_ceil(SAMPLES as u64)))
}
