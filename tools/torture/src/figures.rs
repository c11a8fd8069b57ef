//! Figures of runs, and their merge.

use checker::{Violation, ViolationKind};
use judge::Attack;
use rt::Histogram;
use std::collections::BTreeMap;

pub const TRUE_KINDS: usize = plant::ViolationKind::ALL.len();

pub const KINDS: usize = ViolationKind::ALL.len();

pub trait Merge {
    fn merge(&mut self, later: Self);
}

pub fn merged<T: Merge + Default>(parts: impl IntoIterator<Item = T>) -> T {
    parts.into_iter().fold(T::default(), |mut all, part| {
        all.merge(part);
        all
    })
}

impl Merge for u64 {
    fn merge(&mut self, later: Self) {
        *self += later;
    }
}

impl Merge for f64 {
    fn merge(&mut self, later: Self) {
        *self += later;
    }
}

/// The first one counts.
impl<T> Merge for Option<T> {
    fn merge(&mut self, later: Self) {
        *self = self.take().or(later);
    }
}

impl<T: Merge, const N: usize> Merge for [T; N] {
    fn merge(&mut self, later: Self) {
        self.iter_mut().zip(later).for_each(|(mine, theirs)| mine.merge(theirs));
    }
}

/// Least of some values. Infinite without any.
#[derive(Clone, Copy, Debug)]
pub struct Least(pub f64);

/// Greatest of some values. 0 without any.
#[derive(Clone, Copy, Debug, Default)]
pub struct Most(pub f64);

impl Default for Least {
    fn default() -> Self {
        Self(f64::INFINITY)
    }
}

impl Merge for Least {
    fn merge(&mut self, later: Self) {
        self.0 = self.0.min(later.0);
    }
}

impl Merge for Most {
    fn merge(&mut self, later: Self) {
        self.0 = self.0.max(later.0);
    }
}

/// Counts by reason, each with the text of the first one.
#[derive(Clone, Debug, Default)]
pub struct Reasons(pub BTreeMap<String, (u64, String)>);

impl Reasons {
    pub fn count(&mut self, reason: String, text: impl FnOnce() -> String) {
        self.0.entry(reason).or_insert_with(|| (0, text())).0 += 1;
    }
}

impl Merge for Reasons {
    fn merge(&mut self, later: Self) {
        for (reason, (count, first)) in later.0 {
            self.0.entry(reason).or_insert((0, first)).0 += count;
        }
    }
}

/// Distribution of durations, to `DIGITS` significant digits.
#[derive(Clone, Debug)]
pub struct Durations<const DIGITS: u8 = 3>(pub Histogram);

impl<const DIGITS: u8> Default for Durations<DIGITS> {
    fn default() -> Self {
        Self(Histogram::with_digits(DIGITS))
    }
}

impl<const DIGITS: u8> Merge for Durations<DIGITS> {
    fn merge(&mut self, later: Self) {
        self.0.merge(&later.0);
    }
}

macro_rules! figures {
    ($($(#[$meta:meta])* $name:ident { $($(#[$doc:meta])* $field:ident: $kind:ty,)* })*) => { $(
        $(#[$meta])*
        #[derive(Clone, Debug, Default)]
        pub struct $name {
            $($(#[$doc])* pub $field: $kind,)*
        }

        impl Merge for $name {
            fn merge(&mut self, later: Self) {
                $(self.$field.merge(later.$field);)*
            }
        }
    )* };
}

figures! {
    AttackFigures {
        ticks: u64,
        /// Violations in executed steps and rolled-out plans.
        violations: u64,
        /// Motions that were requested but not certified.
        fallbacks: u64,
        denials: u64,
        /// Ticks in which whole-body control reported a command within a millimetre of d_min.
        near: u64,
        /// Durations of both stages. There are many such kinds, so they have fewer digits.
        tick: Durations<2>,
    }

    RunFigures {
        ticks: u64,
        /// Violations by kind: executed steps and rolled-out plans.
        violations: [u64; KINDS],
        /// Violations among them that were found in rolled-out plans.
        rollout_violations: [u64; KINDS],
        /// The first violation of an executed step, with its part.
        first: Option<(Violation, u64)>,
        true_violations: [u64; TRUE_KINDS],
        /// The first violation of true motion, with its part.
        first_true: Option<(plant::Violation, u64)>,
        true_speed_ratio_max: Most,
        /// Least true clearance, m.
        true_clearance_min_m: Least,
        /// Least clearance over executed steps and rolled-out plans, m.
        min_clearance_m: Least,
        /// Least clearance over everything executed, m. This includes the driver's own stops, which are not proved.
        min_unproved_clearance_m: Least,
        tick: Durations,
        /// Motions that were requested but not certified.
        fallbacks: u64,
        /// Motions among them whose torques could not be certified.
        overloads: u64,
        /// Largest torque over its effort limit, in executed steps.
        torque_share_max: Most,
        /// The same in rolled-out plans.
        rollout_torque_share: Most,
        denials: u64,
        denied_for: Reasons,
        /// Commands that the driver refused though its fault was not latched and it was not suspended.
        refusals: u64,
        refused_for: Reasons,
        missed: u64,
        /// Commands that never arrived.
        lost: u64,
        overslept: u64,
        latches: u64,
        /// Times the robot rested too close to start after a stop of its own, and was recovered.
        recoveries: u64,
        /// Times control continued from the driver's state instead of its own last command.
        reseeds: u64,
        rollouts: u64,
        /// Longest plan of any command, s.
        worst_stop_s: Most,
        /// Stops that were watched from the permit's end to rest.
        stops: u64,
        /// Longest of these stops, s.
        worst_watched_stop_s: Most,
        /// Stops among them that took longer than their bound.
        late_stops: u64,
        /// Stops among them that took longer than B(v), because the motors had little reserve.
        gentle_stops: u64,
        /// Sum of the distances of all revolute joints, rad.
        travelled_rad: f64,
        attacks: [AttackFigures; Attack::ALL.len()],
        goals: Goals,
    }

    Goals {
        /// Number of goals that were tried.
        goals: u64,
        /// Goals that the robot reached, and stood on, within 8 s.
        reached: u64,
        /// Number of returns to the home posture within 8 s, from wherever the previous goal left the robot.
        returned: u64,
    }
}

impl RunFigures {
    pub fn true_violations_total(&self) -> u64 {
        self.true_violations.iter().sum()
    }

    pub fn violations_total(&self) -> u64 {
        self.violations.iter().sum()
    }

    pub fn violations_of(&self, kind: ViolationKind) -> u64 {
        self.violations[kind as usize]
    }

    /// Returns true if the run passed. No command and no true motion broke a limit, no stop took too long, and
    /// the driver refused nothing.
    pub fn kept(&self) -> bool {
        let violations = self.violations_total() + self.true_violations_total();
        violations == 0 && self.late_stops == 0 && self.refusals == 0
    }
}

impl AttackFigures {
    /// Returns the share of the ticks that were within a millimetre of d_min.
    pub fn near_share(&self) -> f64 {
        self.near as f64 / self.ticks.max(1) as f64
    }
}

/// Least share of the goals from which the robot must return home. TIAGo++ returned from 168 of 168
/// (`docs/results/torture.md`). A robot that does not return stands against itself or an obstacle, and so it does in use.
const RETURNED_SHARE_MIN: f64 = 0.9;

impl Goals {
    /// Returns the reason why a run with these goals failed. `None` if the robot returned home often enough.
    pub fn failure(&self) -> Option<String> {
        let Self { goals, returned, .. } = self;
        let percent = 100.0 * RETURNED_SHARE_MIN;
        let sentence = || {
            format!(
                "{returned} of {goals} times back home within 8 s, must be at least {percent} %: choose [home_rad] with more \
                 clearance, or judge the capsules (`collision cover`)"
            )
        };
        (self.share(*returned) < RETURNED_SHARE_MIN).then(sentence)
    }

    /// Share of the goals of which this many count. It is 1 without any goals.
    pub fn share(&self, count: u64) -> f64 {
        if self.goals == 0 { 1.0 } else { count as f64 / self.goals as f64 }
    }
}
