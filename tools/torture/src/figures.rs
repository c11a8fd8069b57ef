//! Figures of runs, and their merge.

use crate::attack::Attack;
use rt::Histogram;
use sim::{Violation, ViolationKind};
use std::collections::BTreeMap;

/// Significant digits of the durations of one kind of attack. There are many such kinds.
const DIGITS_OF_ATTACK: u8 = 2;

/// Number of kinds of violations of true motion.
pub const TRUE_KINDS: usize = plant::ViolationKind::ALL.len();

/// Number of kinds of violations.
pub const KINDS: usize = ViolationKind::ALL.len();

/// Figures of one kind of attack.
#[derive(Clone, Debug)]
pub struct AttackFigures {
    /// Ticks under this attack.
    pub ticks: u64,
    /// Violations in executed steps and rolled-out plans.
    pub violations: u64,
    /// Motions that were requested but not certified.
    pub fallbacks: u64,
    /// Commands denied by the gate.
    pub denials: u64,
    /// Ticks in which whole-body control reported a command within a millimetre of d_min.
    pub near: u64,
    /// Durations of both stages.
    pub tick: Histogram,
}

impl Default for AttackFigures {
    fn default() -> Self {
        let tick = Histogram::with_digits(DIGITS_OF_ATTACK);
        Self { ticks: 0, violations: 0, fallbacks: 0, denials: 0, near: 0, tick }
    }
}

/// Location of a violation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Place {
    /// The violation. Its `k` is the tick within the part.
    pub violation: Violation,
    /// The part of the run.
    pub part: u64,
    /// The seed of that part.
    pub seed: u64,
}

/// Figures of a run.
#[derive(Clone, Debug)]
pub struct Figures {
    /// Ticks of the grid.
    pub ticks: u64,
    /// Violations by kind: executed steps and rolled-out plans.
    pub violations: [u64; KINDS],
    /// Violations among them that were found in rolled-out plans.
    pub rollout_violations: [u64; KINDS],
    /// The first violation of an executed step.
    pub first: Option<Place>,
    /// Violations of the joints' true motion, by kind.
    pub true_violations: [u64; TRUE_KINDS],
    /// The first violation of true motion, with its part.
    pub first_true: Option<(plant::Violation, u64)>,
    /// Largest ratio of true speed to its limit.
    pub true_speed_ratio_max: f64,
    /// Least true clearance, m.
    pub true_clearance_min_m: f64,
    /// Least clearance over executed steps and rolled-out plans, m.
    pub min_clearance_m: f64,
    /// Least clearance over everything executed, m. This includes the driver's own stops, which are not proved.
    pub min_unproved_clearance_m: f64,
    /// Durations of both stages.
    pub tick: Histogram,
    /// Motions that were requested but not certified.
    pub fallbacks: u64,
    /// Motions among them whose torques could not be certified.
    pub overloads: u64,
    /// Largest torque over its effort limit, in executed steps and in rolled-out plans.
    pub torque_share_max: f64,
    /// See `torque_share_max`.
    pub rollout_torque_share: f64,
    /// Commands denied by the gate.
    pub denials: u64,
    /// Denied commands by reason, each with the text of the first one.
    pub denied_for: BTreeMap<String, (u64, String)>,
    /// Commands that the driver refused though its fault was not latched and it was not suspended.
    pub refusals: u64,
    /// Refused commands by reason, each with the text of the first one.
    pub refused_for: BTreeMap<String, (u64, String)>,
    /// Ticks in which control did not run.
    pub missed: u64,
    /// Commands that never arrived.
    pub lost: u64,
    /// Ticks in which the driver did not run.
    pub overslept: u64,
    /// Times the driver latched its fault.
    pub latches: u64,
    /// Times the robot rested too close to start after a stop of its own, and was recovered.
    pub recoveries: u64,
    /// Times control continued from the driver's state instead of its own last command.
    pub reseeds: u64,
    /// Plans rolled out to rest.
    pub rollouts: u64,
    /// Longest plan of any command, s.
    pub worst_stop_s: f64,
    /// Stops that were watched from the permit's end to rest.
    pub stops: u64,
    /// Longest of these stops, s.
    pub worst_watched_stop_s: f64,
    /// Stops among them that took longer than their bound.
    pub late_stops: u64,
    /// Stops among them that took longer than B(v), because the motors had little reserve.
    pub gentle_stops: u64,
    /// Sum of the distances of all revolute joints, rad.
    pub travelled_rad: f64,
    /// Figures by kind of attack.
    pub attacks: [AttackFigures; Attack::ALL.len()],
}

impl Default for Figures {
    fn default() -> Self {
        Self {
            ticks: 0,
            violations: [0; KINDS],
            rollout_violations: [0; KINDS],
            first: None,
            true_violations: [0; TRUE_KINDS],
            first_true: None,
            true_speed_ratio_max: 0.0,
            true_clearance_min_m: f64::INFINITY,
            min_clearance_m: f64::INFINITY,
            min_unproved_clearance_m: f64::INFINITY,
            tick: Histogram::new(),
            fallbacks: 0,
            overloads: 0,
            torque_share_max: 0.0,
            rollout_torque_share: 0.0,
            denials: 0,
            denied_for: BTreeMap::new(),
            refusals: 0,
            refused_for: BTreeMap::new(),
            missed: 0,
            lost: 0,
            overslept: 0,
            latches: 0,
            recoveries: 0,
            reseeds: 0,
            rollouts: 0,
            worst_stop_s: 0.0,
            stops: 0,
            worst_watched_stop_s: 0.0,
            late_stops: 0,
            gentle_stops: 0,
            travelled_rad: 0.0,
            attacks: std::array::from_fn(|_| AttackFigures::default()),
        }
    }
}

impl Figures {
    /// Returns the number of violations of the joints' true motion, of all kinds.
    pub fn true_violations_total(&self) -> u64 {
        self.true_violations.iter().sum()
    }

    /// Returns the number of violations of all kinds.
    pub fn violations_total(&self) -> u64 {
        self.violations.iter().sum()
    }

    /// Returns the number of violations of one kind.
    pub fn violations_of(&self, kind: ViolationKind) -> u64 {
        self.violations[kind as usize]
    }

    /// Returns true if the run passed. No command and no true motion broke a limit, no stop took too long, and
    /// the driver refused nothing.
    pub fn kept(&self) -> bool {
        let violations = self.violations_total() + self.true_violations_total();
        violations == 0 && self.late_stops == 0 && self.refusals == 0
    }

    /// Adds the figures of a later part.
    pub fn merge(&mut self, other: Self) {
        for i in 0..KINDS {
            self.violations[i] += other.violations[i];
            self.rollout_violations[i] += other.rollout_violations[i];
        }
        for (mine, theirs) in self.true_violations.iter_mut().zip(other.true_violations) {
            *mine += theirs;
        }
        self.first_true = self.first_true.or(other.first_true);
        self.true_speed_ratio_max = self.true_speed_ratio_max.max(other.true_speed_ratio_max);
        self.true_clearance_min_m = self.true_clearance_min_m.min(other.true_clearance_min_m);
        self.ticks += other.ticks;
        self.first = self.first.or(other.first);
        self.min_clearance_m = self.min_clearance_m.min(other.min_clearance_m);
        self.min_unproved_clearance_m = self.min_unproved_clearance_m.min(other.min_unproved_clearance_m);
        self.tick.merge(&other.tick);
        self.fallbacks += other.fallbacks;
        self.overloads += other.overloads;
        self.torque_share_max = self.torque_share_max.max(other.torque_share_max);
        self.rollout_torque_share = self.rollout_torque_share.max(other.rollout_torque_share);
        self.denials += other.denials;
        for (reason, (count, first)) in other.denied_for {
            self.denied_for.entry(reason).or_insert((0, first)).0 += count;
        }
        self.refusals += other.refusals;
        for (reason, (count, first)) in other.refused_for {
            self.refused_for.entry(reason).or_insert((0, first)).0 += count;
        }
        self.missed += other.missed;
        self.lost += other.lost;
        self.overslept += other.overslept;
        self.latches += other.latches;
        self.recoveries += other.recoveries;
        self.reseeds += other.reseeds;
        self.rollouts += other.rollouts;
        self.worst_stop_s = self.worst_stop_s.max(other.worst_stop_s);
        self.stops += other.stops;
        self.worst_watched_stop_s = self.worst_watched_stop_s.max(other.worst_watched_stop_s);
        self.late_stops += other.late_stops;
        self.gentle_stops += other.gentle_stops;
        self.travelled_rad += other.travelled_rad;
        for (mine, theirs) in self.attacks.iter_mut().zip(other.attacks) {
            mine.ticks += theirs.ticks;
            mine.violations += theirs.violations;
            mine.fallbacks += theirs.fallbacks;
            mine.denials += theirs.denials;
            mine.near += theirs.near;
            mine.tick.merge(&theirs.tick);
        }
    }
}
