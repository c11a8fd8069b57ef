//! The way back for a robot that stands outside its limits or without enough clearance. The motion is slow,
//! and leads only inward and apart.
//!
//! Joints beyond their range move inward at the recovery's speed. Every other joint may move if that takes
//! near pairs apart. Let u be the joint velocities in shares of that speed, n the pairs with the least
//! distance left, and g their gradients. Then
//!
//! ```text
//! minimise  |u - u_ref|^2        u_ref: +-1 inward for a joint outside, else 0
//! such that g . v(u) >= -rate (d - goal)         [near: opens; else: comes no closer than the goal]
//!           0 <= u inward                        [a joint outside never turns outward]
//!           |u| <= 1, and less towards a limit
//! ```
//!
//! All joints approach their velocities by the same linear law, a critically damped second order with jerk =
//! w^2 (v_u - v) - 2 w a. They stop in proportion (jerk of a stop ~ its speed). So from rest the whole motion
//! keeps the direction u, in which every near pair's distance grows. If one joint braked sooner than the
//! others, the motion would leave this direction.
//!
//! Nothing of that is trusted. A motion is accepted only if all of this holds at every tick from now to rest:
//! no joint outside moves further out, and no near pair comes closer. Also, the certificate must hold with
//! each near pair's present distance in place of d_min.

use crate::certificate::{Purpose, Scratch, certify};
use crate::choose::Choice;
use crate::clearance::Anchor;
use crate::config::{Config, ENGAGE_MARGIN_M, PLANNED_SHARE};
use crate::geometry::Geometry;
use crate::hand::HandSpeed;
use crate::nearest::Nearest;
use crate::plan::{JointState, JointStop, PlannedMotion, highest_of_phase, negated};
use crate::qp::{self, ActiveSet, Problem, Status};
use crate::tick::Candidate;
use crate::torque::{self, Load, TorqueScratch};
use crate::trajectory::{JointTrajectory, Trajectory};
use messages::{JOINTS_MAX, JointMotion, TICK_S};
use robot::Solid;

/// Largest speed of a recovery, rad/s and m/s. Assumption: a hand at 0.9 m then moves at 90 mm/s. This is below
/// the 250 mm/s that ISO 10218-1 requires of manual motion at reduced speed, even if three joints add up.
const SPEED_RAD_PER_S: f64 = 0.1;
const SPEED_M_PER_S: f64 = 0.01;
/// Share of this speed that is used for planning. The rest is for changes of direction.
const AIMED_SHARE: f64 = 0.9;
/// w of the law, 1/s. A change of speed takes 0.15 s. w^2 times twice the speed stays below an arm's jerk
/// limit (180 of 320 rad/s^3). The lift's limit is lower. Where it binds, the motion is not in proportion,
/// and is dropped if a pair closes.
const BANDWIDTH_PER_S: f64 = 30.0;
/// Duration of a stop from steady motion, s. Its jerk is 4 v / D^2, 60 rad/s^3 at the largest speed.
const STOP_S: f64 = 0.08;
/// Least share of the jerk limit in a stop, so that a stop from almost no speed ends.
const STOP_JERK_SHARE: f64 = 1e-3;
/// Largest number of ticks of a stop: two and a half times [`STOP_S`].
const STOP_TICKS_MAX: usize = 300;
/// Distance beyond d_min to which pairs are opened, m. It is the distance that engaging requires, and a
/// little more for the rounding of other kinematics.
const GOAL_M: f64 = ENGAGE_MARGIN_M + 1e-4;
/// Distance beyond the goal at which the opening aims, m. So the motion does not creep into the goal.
const BEYOND_M: f64 = 5e-4;
/// Rate of opening and approach per distance, 1/s.
const RATE_PER_S: f64 = 10.0;
/// Opening of a pair, as a share of what the joints could do for it.
const OPENING_SHARE: f64 = 0.5;
/// Pairs farther from the goal than this have no row, m. It is a second at 0.1 m/s.
const NEAR_M: f64 = 0.1;
/// Rate of approach to a position limit, 1/s. The speed falls from a distance of 18 mrad on.
const LIMIT_RATE_PER_S: f64 = 5.0;
/// Rounding of a distance that does not change, m.
const ROUNDING_M: f64 = 1e-12;
/// Shares of the velocities that are tried.
const SHARES: [f64; 3] = [1.0, 0.4, 0.1];
/// Shares of the opening that are tried, if the whole opening is infeasible. At the last one nothing comes closer.
const OPENINGS: [f64; 3] = [1.0, 0.2, 0.0];

/// Working memory.
#[derive(Clone, Debug)]
pub(crate) struct Recovery {
    problem: Problem,
    /// The pair of each row, and its distance beyond the goal, m.
    rows: Nearest<usize>,
    /// Every pair nearer than the goal, with its distance at the previous tick. The first `near_count` are valid.
    near: Vec<(usize, f64)>,
    near_count: usize,
    probe: Anchor,
}

/// State and range of a joint that may move.
#[derive(Clone, Copy, Debug)]
struct Reach {
    x: JointState,
    /// Range of this tick. If the joint is outside, the range ends at its position.
    q: [f64; 2],
    /// Largest speed of the recovery.
    speed: f64,
}

impl Recovery {
    pub(crate) fn new(geometry: &Geometry, q: [f64; JOINTS_MAX]) -> Self {
        Self {
            problem: Problem::default(),
            rows: Nearest::new(),
            near: vec![(0, 0.0); geometry.pair_count()],
            near_count: 0,
            probe: Anchor::new(geometry, q),
        }
    }

    /// Returns the next step of the way back. Returns the plan if there is nothing to do, or if no step can be proved.
    pub(crate) fn choose(
        &mut self,
        config: &Config,
        (scratch, torque, load): (&mut Scratch, &mut TorqueScratch, Option<&Load>),
        anchor: &mut Anchor,
        before: &JointMotion,
        on_plan: &JointMotion,
    ) -> Choice {
        let mut choice = Choice::plan(*on_plan);
        torque.begin_tick();
        let reach = reach(config, before);
        let Some(mut wanted) = self.velocities(config, anchor, &reach) else { return choice };
        let (chain, places, now) = (&config.geometry.chain, anchor.placements, anchor.turned);
        let (places, now) = (&places, &now);
        if let Some(hand) = &config.hand {
            let shares = hand.shares(chain, places, &wanted);
            wanted = std::array::from_fn(|j| shares[j] * wanted[j]);
        }
        for share in SHARES {
            let Some(attempt) = Attempt::new(config, &reach, before, on_plan, &wanted.map(|v| share * v)) else {
                continue;
            };
            let slow = |hand: &HandSpeed| hand.is_kept(chain, places, &attempt.motion);
            if !config.hand.as_ref().is_none_or(slow) {
                choice.fallbacks += 1;
                continue;
            }
            if attempt.fresh == 0 || !self.only_opens(&config.geometry, anchor, &attempt.motion) {
                choice.fallbacks += 1;
                continue;
            }
            let overloaded = load.and_then(|load| {
                let verdict = torque::prove(load, chain, (&attempt.motion, now), attempt.fresh, torque);
                choice.evaluations += verdict.evaluations;
                verdict.blamed
            });
            if overloaded.is_some() {
                choice.fallbacks += 1;
                choice.overloads += 1;
                choice.overloaded = choice.overloaded.or(overloaded);
                continue;
            }
            let verdict = certify(&config.geometry, &attempt.motion, Purpose::Recovery, attempt.fresh, anchor, scratch);
            choice.evaluations += verdict.evaluations;
            if verdict.blamed.is_none() {
                return Choice { next: attempt.next, candidate: Candidate::All, fresh: attempt.fresh, ..choice };
            }
            choice.fallbacks += 1;
            choice.refused = choice.refused.or(verdict.blamed);
        }
        choice
    }

    /// The velocities that lead back, rad/s or m/s. None if no joint is outside and no pair is near.
    fn velocities(
        &mut self,
        config: &Config,
        anchor: &mut Anchor,
        reach: &[Reach; JOINTS_MAX],
    ) -> Option<[f64; JOINTS_MAX]> {
        let mut needed = false;
        for j in 0..config.count() {
            let (x, bounds) = (reach[j].x, &config.bounds[j]);
            let towards = |room: f64| (LIMIT_RATE_PER_S * room / reach[j].speed).clamp(0.0, 1.0);
            let (below, above) = (x.q < bounds.q_min, x.q > bounds.q_max);
            needed |= below || above;
            self.problem.lower[j] = if below { 0.0 } else { -towards(x.q - bounds.q_min) };
            self.problem.upper[j] = if above { 0.0 } else { towards(bounds.q_max - x.q) };
            self.problem.reference[j] = f64::from(u8::from(below)) - f64::from(u8::from(above));
        }
        self.find_near(&config.geometry, anchor);
        needed |= self.near_count > 0;
        // Within a box every depth has the same distance, so the gradient shows no way out.
        let lost = self.near[..self.near_count].iter().any(|&(pair, _)| is_within_box(&config.geometry, anchor, pair));
        if !needed || lost {
            return None;
        }
        for k in 0..self.problem.row_count {
            let gradient = anchor.gradient(&config.geometry, self.rows.keys[k]);
            self.problem.rows[k] = std::array::from_fn(|j| gradient[j] * reach[j].speed);
        }
        OPENINGS
            .into_iter()
            .find_map(|opening| self.solve(opening))
            .map(|u| std::array::from_fn(|j| AIMED_SHARE * reach[j].speed * u[j].clamp(-1.0, 1.0)))
    }

    /// Lists all pairs that are nearer than the goal. The rows get the pairs with the least distance beyond
    /// it, in that order.
    fn find_near(&mut self, geometry: &Geometry, anchor: &mut Anchor) {
        self.rows.clear();
        self.near_count = 0;
        for pair in 0..geometry.pair_count() {
            if anchor.is_beyond(geometry, pair, geometry.d_min_m + GOAL_M + NEAR_M) {
                continue;
            }
            let separation = anchor.separation(geometry, pair);
            let left = separation - geometry.d_min_m - GOAL_M;
            if left < 0.0 {
                self.near[self.near_count] = (pair, separation);
                self.near_count += 1;
            }
            if left <= NEAR_M {
                self.rows.insert(left, pair);
            }
        }
        self.problem.row_count = self.rows.len;
    }

    /// Solves the program with a share of the opening. None if it has no solution.
    fn solve(&mut self, opening: f64) -> Option<[f64; JOINTS_MAX]> {
        let p = &mut self.problem;
        for k in 0..p.row_count {
            let most: f64 = (0..p.count).map(|j| (p.rows[k][j] * p.lower[j]).max(p.rows[k][j] * p.upper[j])).sum();
            let left = self.rows.left[k];
            p.least[k] = if left < 0.0 {
                opening * (RATE_PER_S * (BEYOND_M - left)).min(OPENING_SHARE * most)
            } else {
                -RATE_PER_S * left
            };
        }
        let solution = qp::solve(p, &mut ActiveSet::default());
        (solution.status == Status::Optimal).then_some(solution.z)
    }

    /// Returns true if no pair nearer than the goal comes closer at any tick to rest.
    fn only_opens(&mut self, geometry: &Geometry, anchor: &mut Anchor, motion: &Trajectory) -> bool {
        let goal = geometry.d_min_m + GOAL_M;
        let near = &mut self.near[..self.near_count];
        if near.is_empty() {
            return true;
        }
        // A smaller share of the velocities begins where the previous one began.
        for (pair, last) in near.iter_mut() {
            *last = anchor.separation(geometry, *pair);
        }
        let ticks = (motion.end_s() / TICK_S).ceil() as usize;
        if ticks > STOP_TICKS_MAX {
            return false;
        }
        for tick in 1..=ticks {
            self.probe.go(geometry, motion.posture(tick as f64 * TICK_S));
            for (pair, last) in near.iter_mut() {
                // A distance beyond the goal may come back to it.
                let distance = self.probe.separation(geometry, *pair).min(goal);
                if distance < *last - ROUNDING_M {
                    return false;
                }
                *last = distance;
            }
        }
        true
    }
}

/// Returns true if the axis of a capsule meets a box of the surroundings.
fn is_within_box(geometry: &Geometry, anchor: &mut Anchor, pair: usize) -> bool {
    let checked = &geometry.pairs[pair];
    let is_box = checked.obstacle.is_some_and(|k| matches!(geometry.obstacles[k], Solid::Box { .. }));
    is_box && anchor.separation(geometry, pair) <= ROUNDING_M - checked.radii
}

fn reach(config: &Config, before: &JointMotion) -> [Reach; JOINTS_MAX] {
    std::array::from_fn(|j| {
        let (x, bounds) = (before.joint(j), &config.bounds[j]);
        let slides = config.geometry.chain.links().get(j).is_some_and(|link| link.prismatic);
        let speed = if slides { SPEED_M_PER_S } else { SPEED_RAD_PER_S };
        let q = [bounds.q_min.min(x.q), bounds.q_max.max(x.q)];
        Reach { x, q, speed: PLANNED_SHARE * speed.min(bounds.v_max) }
    })
}

/// One attempt of a recovery step.
struct Attempt {
    next: JointMotion,
    motion: Trajectory,
    fresh: u32,
}

impl Attempt {
    /// Creates a tick towards the velocities. None if a joint would leave its range or exceed its speed on
    /// the way to rest.
    fn new(
        config: &Config,
        reach: &[Reach; JOINTS_MAX],
        before: &JointMotion,
        on_plan: &JointMotion,
        wanted: &[f64; JOINTS_MAX],
    ) -> Option<Self> {
        let mut attempt = Self { next: *on_plan, motion: Trajectory::stops(before), fresh: 0 };
        for j in 0..config.count() {
            let (Reach { x, q, speed }, bounds) = (reach[j], &config.bounds[j]);
            if wanted[j] == 0.0 && x.is_at_rest() {
                continue;
            }
            let w = BANDWIDTH_PER_S;
            let jerk = (w * w * (wanted[j] - x.v) - 2.0 * w * x.a).clamp(-bounds.j_max, bounds.j_max);
            let after = x.after(jerk, TICK_S);
            // The stop's jerk is of the first degree in (v, a), so that proportional motions stop in proportion.
            let j_stop = 4.0 * after.v.abs() / (STOP_S * STOP_S) + 4.0 * after.a.abs() / STOP_S;
            let j_stop = j_stop.clamp(STOP_JERK_SHARE * bounds.j_max, bounds.j_max);
            let stop = JointStop::new(after.v, after.a, bounds.a_max, j_stop);
            let (low, high) = stop.extremes(after);
            // A joint may turn within the tick.
            let tick_low = -highest_of_phase(negated(x), -jerk, TICK_S).0;
            let tick_high = highest_of_phase(x, jerk, TICK_S).0;
            let inside = low.min(tick_low) >= q[0] && high.max(tick_high) <= q[1];
            let slow = after.v.abs().max(after.coasting_velocity(j_stop).abs()) <= speed;
            if !inside || !slow || after.a.abs() > bounds.a_max {
                return None;
            }
            attempt.next.set_joint(j, after, stop);
            attempt.motion.joints[j] = JointTrajectory::tick_then_stop(x, jerk, &stop);
            attempt.fresh |= 1 << j;
        }
        debug_assert!(attempt.fresh & !config.geometry.chain.all() == 0);
        Some(attempt)
    }
}
