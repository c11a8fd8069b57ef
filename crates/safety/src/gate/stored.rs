//! The stop plan that is in force, advanced by integers from where it began, so that rounding does not add up.

use messages::{JOINTS, StopPlan};

use super::fixed::{JERK_CEILING, Phase, Point, TIME_CEILING_S, TIME_UNITS, UNITS, quantise, ticks_long};

/// Longest time a plan is played for, in ticks: 49 s, and three longest phases are 48 s. Then every joint is at rest.
const PLAYED_MAX: u64 = 73_500;

/// What a joint has left of its stop.
pub(super) type Phases = [Phase; 3];

/// A state with the stop that begins there.
#[derive(Clone, Copy, Debug)]
pub(super) struct Stored {
    /// Where the plan began.
    pub(super) origin: [Point; JOINTS],
    /// The stop from there.
    pub(super) phases: [Phases; JOINTS],
    /// How many ticks of it have been played.
    pub(super) played: u64,
}

/// A joint's stop in units; None where it is no plan of finite, ordered phases within the ceilings.
pub(super) fn quantised_phases(plan: &StopPlan, joint: usize) -> Option<Phases> {
    let mut phases = [Phase::default(); 3];
    for (i, phase) in phases.iter_mut().enumerate() {
        let duration = quantise(plan.duration_s[joint][i], TIME_CEILING_S, TIME_UNITS)?;
        let jerk = quantise(plan.jerk[joint][i], JERK_CEILING, UNITS)?;
        if duration < 0 {
            return None;
        }
        *phase = Phase { jerk, duration };
    }
    Some(phases)
}

/// Where `phases` lead from `origin` in `played`, and what is left of them. After the last phase the joint is at rest.
fn advanced(origin: Point, phases: &Phases, played: i64) -> (Point, Phases) {
    let (mut point, mut rest, mut left) = (origin, *phases, played);
    for phase in &mut rest {
        let t = left.min(phase.duration);
        point = point.after(phase.jerk, t);
        phase.duration -= t;
        left -= t;
    }
    if rest.iter().all(|phase| phase.duration == 0) {
        (point.v, point.a) = (0, 0);
        rest = Phases::default();
    }
    (point, rest)
}

impl Stored {
    /// At rest at `origin`'s positions.
    pub(super) fn new(origin: [Point; JOINTS], phases: [Phases; JOINTS]) -> Self {
        Self { origin, phases, played: 0 }
    }

    /// The same plan, `ticks` later.
    pub(super) fn later(&self, ticks: u64) -> Self {
        Self { played: self.played.saturating_add(ticks).min(PLAYED_MAX), ..*self }
    }

    /// Where joint `j` is, and what is left of its stop.
    pub(super) fn joint(&self, j: usize) -> (Point, Phases) {
        advanced(self.origin[j], &self.phases[j], ticks_long(self.played))
    }
}

/// Writes a joint's remaining stop into a message; exact, since every value has at most 53 significant bits where it
/// came from one.
pub(super) fn write_phases(plan: &mut StopPlan, joint: usize, phases: &Phases) {
    for (i, phase) in phases.iter().enumerate() {
        plan.jerk[joint][i] = phase.jerk as f64 / UNITS;
        plan.duration_s[joint][i] = phase.duration as f64 / TIME_UNITS;
    }
}
