//! The barrier changes the wanted jerks as little as possible, so that no near pair comes too close in the stop.
//!
//! Every jerk of a tick leads to a position p where the joint would then come to rest, and p grows with the
//! jerk. The program in these *stop positions* is
//!
//! ```text
//! minimise  (p - p_ref)^T M (p - p_ref)
//! such that p(j_lo) <= p <= p(j_hi)                                  [the joint's limits, see `interval`]
//!           g_s . S_s (p - p_k) >= min(-gamma l_s, push)             [for every near pair, at samples s of the plan]
//! ```
//!
//! Here p_k is the end of the plan in force, and g_s the gradient of the pair's distance d_s at sample s.
//! The distance that is left there is l_s = d_s - d_min - eps. S_s = dq_s / dp is the change of the position
//! at the sample per change of the end. The samples are the end and three postures on the way.
//!
//! A pair with l_s > 0 may use up the share gamma of it in one tick. A pair with l_s < 0 is opened, at a
//! share of l_s per tick, and by no more than a quarter of what the joints can do at all. So a row alone is
//! always feasible. The rows limit where the robot *stops*. So a joint that moves along an obstacle keeps its
//! speed. A joint that moves towards it brakes while there is still room.
//!
//! The unknowns are scaled to jerks: z = (p - p_k) k / J, with k the secant slope dj/dp over [j_lo, j_hi]. M is the
//! cost of a deviation in joint velocities, with a weight per joint over its largest speed. If the robot file asks for
//! it, M also contains the cost in angular velocities of the limbs. Then a blocked arm first gives up the joints that
//! turn no limb (wrist, lift). It keeps the directions of its limbs as well as it can.
//!
//! Nothing here is trusted. The result is a proposal, and the certificate decides.

use crate::chain::{JointSet, TurnedJoints, joints};
use crate::clearance::Anchor;
use crate::config::Config;
use crate::geometry::{Geometry, NO_ROWS, Rows};
use crate::interval::Bounds;
use crate::nearest::Nearest;
use crate::plan::{JointState, JointStop};
use crate::qp::{self, ActiveSet, Problem, ROWS_MAX, Status};
use crate::trajectory::{JointTrajectory, Trajectory};
use messages::{JOINTS_MAX, TICK_S};

/// Share of a pair's remaining distance that a tick may use up. With it the stop comes within 1 % of the
/// boundary in 16 ticks. It is far enough from 1 for the next tick to correct the error of linearisation.
const GAMMA: f64 = 0.25;
/// Distance beyond d_min that stops keep, m. Engaging requires the same. It is six times the certificate's
/// own slack, so that an arm that slides does not depend on the certificate.
const EPS_M: f64 = 3e-3;
/// Share of a missing distance that opens in a tick. It is 15 1/s, half the bandwidth of the position loop.
const OPEN: f64 = 0.01;
/// Largest opening per tick, as a share of what the joints can do at most in a tick.
const OPEN_SHARE: f64 = 0.25;
/// Pairs farther apart than this, both now and at the end of the plan, have no rows, m. A tick moves a stop
/// by v_max h and by the change of its length. This is 3 mrad a joint or 15 mm for a stretched arm. A tick
/// may use a quarter of the remaining distance, so a row can bind only below 60 mm.
const NEAR_M: f64 = 0.15;
/// Samples on the way, as shares of the time to rest. The end itself is the fourth sample.
const ON_THE_WAY: [f64; 3] = [0.25, 0.5, 0.75];
/// Halvings of a bracket in the search for a jerk. The secant usually needs four steps.
const INVERSION_STEPS: u32 = 12;
/// Accuracy of this search, as a share of the bracket. It is below the error of the rows' linearisation.
const INVERSION_SHARE: f64 = 1e-3;

/// A z that differs from the wanted one by less than this is unchanged. The difference is rounding of the solver.
const UNCHANGED: f64 = 1e-10;

/// Result of the program.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Program {
    /// There was nothing to solve, because the wanted jerks break no row.
    Idle,
    /// The program was solved, and the wanted jerks were changed.
    Solved,
    /// There is no solution, so the robot keeps to its plan.
    Infeasible,
}

/// The wanted jerk of a joint, and the range for this tick.
#[derive(Clone, Copy, Debug)]
pub(crate) struct JerkRange {
    /// The state before the tick.
    pub x: JointState,
    /// Bounds of the tick.
    pub bounds: Bounds,
    /// The wanted jerk, not limited.
    pub wanted: f64,
    /// The admissible jerk nearest to it.
    pub jerk: f64,
}

/// The range of jerks of a joint, and the positions where it stops for them.
#[derive(Clone, Copy, Debug, Default)]
struct Span {
    jerk: [f64; 2],
    stop: [f64; 2],
    /// The position where the plan stops.
    plan_stop: f64,
    /// z of both ends.
    z: [f64; 2],
    /// dp/dz.
    scale: f64,
    motion: [JointTrajectory; 2],
}

/// A pair at a sample.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Key {
    pair: usize,
    sample: usize,
}

/// Working memory, and the active constraints of the last solution.
#[derive(Clone, Debug)]
pub(crate) struct Barrier {
    way: [Anchor; 3],
    end: Anchor,
    /// Paths of the bodies on the plan, by the rows of [`Geometry::add_paths`], m.
    paths: Rows,
    /// Pairs that may come near on the plan.
    reachable: Vec<u16>,
    /// The pair and the sample of each row, and the distance that is left there, m.
    rows: Nearest<Key>,
    /// The keys of `rows` before those that no choice can break were dropped, and their number.
    listed: [Key; ROWS_MAX],
    listed_len: usize,
    problem: Problem,
    spans: [Span; JOINTS_MAX],
    active: ActiveSet,
    active_keys: [Key; ROWS_MAX],
}

impl Barrier {
    pub(crate) fn new(geometry: &Geometry, q: [f64; JOINTS_MAX]) -> Self {
        let anchor = Anchor::new(geometry, q);
        Self {
            way: [anchor.clone(), anchor.clone(), anchor.clone()],
            end: anchor,
            paths: NO_ROWS,
            reachable: vec![0; geometry.pair_count()],
            rows: Nearest::new(),
            listed: [Key::default(); ROWS_MAX],
            listed_len: 0,
            problem: Problem { count: geometry.chain.count(), ..Problem::default() },
            spans: [Span::default(); JOINTS_MAX],
            active: ActiveSet::default(),
            active_keys: [Key::default(); ROWS_MAX],
        }
    }

    /// The joints where the plan in force ends, at `q`.
    pub(crate) fn ended(&mut self, geometry: &Geometry, q: [f64; JOINTS_MAX]) -> &TurnedJoints {
        self.end.go(geometry, q);
        self.end.pose(geometry);
        &self.end.turned
    }

    /// Changes the jerks of `ranges` so that they keep the rows. `now` is the posture before the tick, and
    /// `plan` is the plan in force there.
    pub(crate) fn apply(
        &mut self,
        config: &Config,
        now: &mut Anchor,
        plan: &Trajectory,
        ranges: &mut [Option<JerkRange>; JOINTS_MAX],
    ) -> Program {
        self.find_near(&config.geometry, now, plan);
        if self.rows.len == 0 {
            return Program::Idle;
        }
        self.span(ranges, plan);
        self.keep_reachable(&config.geometry);
        self.make_rows(&config.geometry, plan);
        if !self.wanted_breaks_a_row(ranges) {
            return Program::Idle;
        }
        self.weigh(config, now);
        let Some(z) = self.solve() else {
            return Program::Infeasible;
        };
        for j in 0..config.count() {
            if let Some(range) = &mut ranges[j] {
                range.jerk = self.spans[j].jerk_at(range, z[j]);
            }
        }
        Program::Solved
    }

    /// Moves to the samples and lists the near pairs. The ones with the least distance left come first.
    fn find_near(&mut self, geometry: &Geometry, now: &mut Anchor, plan: &Trajectory) {
        let end_s = plan.end_s();
        let samples: &[usize] = if end_s > 0.0 {
            self.end.go(geometry, plan.posture(end_s));
            for (anchor, share) in self.way.iter_mut().zip(ON_THE_WAY) {
                anchor.go(geometry, plan.posture(share * end_s));
            }
            &[ON_THE_WAY.len(), 0, 1, 2]
        } else {
            self.end.go(geometry, now.q);
            &[ON_THE_WAY.len()]
        };
        // A key with more left would be dropped, so its pair is measured only if it may have less.
        let most_m = self.most_left_m(geometry, now, samples) + geometry.d_min_m + EPS_M;
        self.rows.clear();
        self.paths = NO_ROWS;
        geometry.add_paths(&std::array::from_fn(|j| plan.joints[j].path()), &mut self.paths);
        // All samples lie on the plan's way from here.
        let mut reachable = std::mem::take(&mut self.reachable);
        let count = geometry.list_reachable(JointSet::MAX, &now.least, &self.paths, |_| most_m, &mut reachable);
        for &pair in &reachable[..count] {
            let pair = usize::from(pair);
            // A pair that is near at none of both ends has no rows.
            if now.least[pair] > NEAR_M && self.end.is_beyond(geometry, pair, NEAR_M)
                || samples.iter().all(|&sample| self.sample(sample).is_beyond(geometry, pair, most_m))
                || !self.is_near(geometry, now, pair)
            {
                continue;
            }
            for &sample in samples {
                if !self.sample(sample).is_beyond(geometry, pair, most_m) {
                    let left = self.left_m(geometry, Key { pair, sample });
                    self.rows.insert(left, Key { pair, sample });
                }
            }
        }
        self.reachable = reachable;
        (self.listed, self.listed_len) = (self.rows.keys, self.rows.len);
    }

    /// A bound of what is left to the keys of a full list, m. If the last tick's keys fill it again, the list has none
    /// with more left than these. Infinite if they do not.
    fn most_left_m(&mut self, geometry: &Geometry, now: &mut Anchor, samples: &[usize]) -> f64 {
        let mut most_m = if self.listed_len == ROWS_MAX { f64::NEG_INFINITY } else { f64::INFINITY };
        for k in 0..self.listed_len {
            let key = self.listed[k];
            if !samples.contains(&key.sample) || !self.is_near(geometry, now, key.pair) {
                return f64::INFINITY;
            }
            most_m = most_m.max(self.left_m(geometry, key));
        }
        most_m
    }

    /// Returns true if a pair is near now or at the end of the plan.
    fn is_near(&mut self, geometry: &Geometry, now: &mut Anchor, pair: usize) -> bool {
        [&mut self.end, now]
            .into_iter()
            .any(|anchor| !anchor.is_beyond(geometry, pair, NEAR_M) && anchor.separation(geometry, pair) < NEAR_M)
    }

    fn sample(&mut self, sample: usize) -> &mut Anchor {
        self.way.get_mut(sample).unwrap_or(&mut self.end)
    }

    /// The distance that is left to a pair at a sample, m.
    fn left_m(&mut self, geometry: &Geometry, Key { pair, sample }: Key) -> f64 {
        self.sample(sample).separation(geometry, pair) - geometry.d_min_m - EPS_M
    }

    /// Sets the range of each joint. A joint without a wanted jerk stays on its plan.
    fn span(&mut self, ranges: &[Option<JerkRange>; JOINTS_MAX], plan: &Trajectory) {
        for j in 0..self.problem.count {
            let plan_stop = plan.joints[j].at(f64::INFINITY).q;
            self.spans[j] = ranges[j].as_ref().map_or_else(Span::default, |range| Span::new(range, plan_stop));
            (self.problem.lower[j], self.problem.upper[j]) = (self.spans[j].z[0], self.spans[j].z[1]);
            let reference = |range: &JerkRange| self.spans[j].reference(range);
            self.problem.reference[j] = ranges[j].as_ref().map_or(0.0, reference);
        }
    }

    /// Drops the rows that no choice can break. A distance changes by at most the sum of reach times change.
    fn keep_reachable(&mut self, geometry: &Geometry) {
        let most: [f64; JOINTS_MAX] =
            std::array::from_fn(|j| self.spans[j].scale * self.spans[j].z[1].max(-self.spans[j].z[0]));
        self.rows.retain(|left, key| {
            let pair = &geometry.pairs[key.pair];
            let change = [pair.a, pair.b].map(|side| {
                let shape = &geometry.shapes[side.capsule];
                (side.from..shape.chain.len()).map(|i| shape.reach[i] * most[shape.chain[i]]).sum::<f64>()
            });
            GAMMA * left <= change[0] + change[1]
        });
    }

    fn make_rows(&mut self, geometry: &Geometry, plan: &Trajectory) {
        let end_s = plan.end_s();
        self.problem.row_count = self.rows.len;
        for k in 0..self.rows.len {
            let Key { pair, sample } = self.rows.keys[k];
            let (anchor, time) = match ON_THE_WAY.get(sample) {
                Some(share) => (&mut self.way[sample], share * end_s),
                None => (&mut self.end, f64::INFINITY),
            };
            let gradient = anchor.gradient(geometry, pair);
            let (mut row, mut reach) = ([0.0; JOINTS_MAX], 0.0);
            for j in 0..self.problem.count {
                if gradient[j] != 0.0 {
                    row[j] = gradient[j] * self.spans[j].shown_at(time) * self.spans[j].scale;
                    reach += (row[j] * self.spans[j].z[0]).max(row[j] * self.spans[j].z[1]);
                }
            }
            let left = self.rows.left[k];
            self.problem.rows[k] = row;
            self.problem.least[k] = if left > 0.0 { -GAMMA * left } else { (-OPEN * left).min(OPEN_SHARE * reach) };
        }
    }

    fn wanted_breaks_a_row(&self, ranges: &[Option<JerkRange>; JOINTS_MAX]) -> bool {
        let p = &self.problem;
        let wanted: [f64; JOINTS_MAX] =
            std::array::from_fn(|j| ranges[j].as_ref().map_or(0.0, |range| self.spans[j].z_at(range, range.jerk)));
        (0..p.row_count).any(|k| (0..p.count).map(|j| p.rows[k][j] * wanted[j]).sum::<f64>() < p.least[k])
    }

    /// Computes H, the cost of a deviation.
    fn weigh(&mut self, config: &Config, now: &Anchor) {
        let h = &mut self.problem.hessian;
        *h = [[0.0; JOINTS_MAX]; JOINTS_MAX];
        let unit: [f64; JOINTS_MAX] = std::array::from_fn(|j| config.bounds[j].j_max);
        for j in 0..config.count() {
            h[j][j] = config.tasks.joint_weight[j] * (unit[j] / config.bounds[j].v_max).powi(2);
        }
        let weight = config.tasks.limb_weight;
        if weight == 0.0 {
            return;
        }
        for (arm, bodies) in config.geometry.chain.arms().into_iter().zip(config.tasks.limb_bodies) {
            for body in bodies {
                let moved = config.geometry.chain.ancestors(body);
                // The lift and the base do not turn a limb. The head is not an ancestor of any limb.
                for i in joints(arm & moved) {
                    for k in joints(arm & moved) {
                        let (first, second) = (now.axis(&config.geometry, i), now.axis(&config.geometry, k));
                        h[i][k] += weight * first.dot(&second) * unit[i] * unit[k];
                    }
                }
            }
        }
    }

    /// Returns the solution. If the opening is infeasible, returns the one in which no pair comes closer.
    fn solve(&mut self) -> Option<[f64; JOINTS_MAX]> {
        let mut warm = self.active.bounds_only();
        for k in 0..self.problem.row_count {
            let known = |i: usize| self.active.has_row(i) && self.active_keys[i] == self.rows.keys[k];
            if (0..ROWS_MAX).any(known) {
                warm.add_row(k);
            }
        }
        let mut solution = qp::solve(&self.problem, &mut warm);
        if solution.status == Status::Infeasible {
            for least in &mut self.problem.least[..self.problem.row_count] {
                *least = least.min(0.0);
            }
            solution = qp::solve(&self.problem, &mut warm);
        }
        if solution.status != Status::Optimal {
            self.active = ActiveSet::default();
            return None;
        }
        (self.active, self.active_keys) = (warm, self.rows.keys);
        Some(solution.z)
    }
}

impl JerkRange {
    /// The state after a tick of jerk `j`, and the stop from there.
    #[inline]
    pub(crate) fn tick(&self, j: f64) -> (JointState, JointStop) {
        let next = self.x.after(j, TICK_S);
        (next, JointStop::new(next.v, next.a, self.bounds.brake, self.bounds.j_max))
    }

    /// Position where the joint stops after a tick of jerk `j`.
    #[inline]
    fn stop_after(&self, j: f64) -> f64 {
        let (next, stop) = self.tick(j);
        stop.stop_position(next)
    }
}

impl Span {
    fn new(range: &JerkRange, plan_stop: f64) -> Self {
        let Some(jerk) = range.bounds.interval(range.x) else {
            return Self::default();
        };
        let motion = jerk.map(|j| JointTrajectory::tick_then_stop(range.x, j, &range.tick(j).1));
        let stop = motion.map(|motion| motion.at(f64::INFINITY).q);
        // There is nothing to choose unless the range is at least a billionth of the jerk limit, and the stop
        // moves at all.
        if jerk[1] - jerk[0] < 1e-9 * range.bounds.j_max || stop[1] <= stop[0] {
            return Self::default();
        }
        let scale = (stop[1] - stop[0]) / (jerk[1] - jerk[0]) * range.bounds.j_max;
        // The plan need not have a constant jerk over the tick. Staying on it is always allowed.
        let z = [((stop[0] - plan_stop) / scale).min(0.0), ((stop[1] - plan_stop) / scale).max(0.0)];
        Self { jerk, stop, plan_stop, z, scale, motion }
    }

    /// S, the change of the position at `time` per change of the stop.
    fn shown_at(&self, time: f64) -> f64 {
        if time == f64::INFINITY || self.scale == 0.0 {
            return 1.0;
        }
        (self.motion[1].at(time).q - self.motion[0].at(time).q) / (self.stop[1] - self.stop[0])
    }

    fn z_at(&self, range: &JerkRange, jerk: f64) -> f64 {
        if self.scale == 0.0 { 0.0 } else { (range.stop_after(jerk) - self.plan_stop) / self.scale }
    }

    /// z of the wanted jerk. Beyond the admissible range, z continues linearly in the jerk. So a wanted jerk
    /// far outside the range weighs as much as it would in velocities.
    fn reference(&self, range: &JerkRange) -> f64 {
        self.z_at(range, range.jerk) + (range.wanted - range.jerk) / range.bounds.j_max
    }

    /// The jerk whose stop is at `z`, found by a bracketed secant. Returns the given jerk if it already stops there.
    fn jerk_at(&self, range: &JerkRange, z: f64) -> f64 {
        if self.scale == 0.0 || (z - self.z_at(range, range.jerk)).abs() < UNCHANGED {
            return range.jerk;
        }
        let goal = self.plan_stop + z * self.scale;
        if goal <= self.stop[0] {
            return self.jerk[0];
        }
        if goal >= self.stop[1] {
            return self.jerk[1];
        }
        let (mut low, mut high) = ((self.jerk[0], self.stop[0] - goal), (self.jerk[1], self.stop[1] - goal));
        let accuracy = INVERSION_SHARE * (high.1 - low.1);
        for step in 0..INVERSION_STEPS {
            let share = if step % 3 == 2 { 0.5 } else { -low.1 / (high.1 - low.1) };
            let jerk = low.0 + share * (high.0 - low.0);
            let off = range.stop_after(jerk) - goal;
            if off.abs() <= accuracy {
                return jerk;
            }
            *(if off < 0.0 { &mut low } else { &mut high }) = (jerk, off);
        }
        low.0
    }
}
