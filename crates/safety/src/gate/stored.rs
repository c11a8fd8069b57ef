//! The stop plan in force. It is computed in integers from its beginning, so that rounding does not add up.

use messages::{JOINTS_MAX, StopPlan};

use super::fixed::{JERK_CEILING, Phase, Point, TIME_CEILING_S, TIME_UNITS, UNITS, quantise, ticks_long};

/// Longest time for which a plan is played, in ticks. It is 49 s, and the three longest phases take 48 s.
/// After it every joint is at rest.
const PLAYED_MAX: u64 = 73_500;

/// The remaining phases of a joint's stop.
pub(super) type Phases = [Phase; 3];

/// A state with the stop that begins there.
#[derive(Clone, Copy, Debug)]
pub(super) struct Stored {
    /// State at which the plan began.
    pub(super) origin: [Point; JOINTS_MAX],
    /// The stop from there.
    pub(super) phases: [Phases; JOINTS_MAX],
    /// Number of ticks that have been played.
    pub(super) played: u64,
}

/// Returns a joint's stop in units, or None if its phases are not finite, not ordered, or beyond the ceilings.
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

/// Returns the point to which `phases` lead from `origin` after `played`, and the rest of them. After the
/// last phase the joint is at rest.
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
    /// Creates a plan of which nothing has been played.
    pub(super) fn new(origin: [Point; JOINTS_MAX], phases: [Phases; JOINTS_MAX]) -> Self {
        Self { origin, phases, played: 0 }
    }

    /// Plays `ticks` of the plan.
    pub(super) fn play(&mut self, ticks: u64) {
        self.played = self.played_after(ticks);
    }

    /// Returns the point of joint `j` and the rest of its stop, `ticks` from now.
    pub(super) fn joint(&self, j: usize, ticks: u64) -> (Point, Phases) {
        advanced(self.origin[j], &self.phases[j], ticks_long(self.played_after(ticks)))
    }

    fn played_after(&self, ticks: u64) -> u64 {
        self.played.saturating_add(ticks).min(PLAYED_MAX)
    }
}

/// Writes a joint's remaining stop into a message. This is exact, since every value that came from a message
/// has at most 53 significant bits.
pub(super) fn write_phases(plan: &mut StopPlan, joint: usize, phases: &Phases) {
    for (i, phase) in phases.iter().enumerate() {
        plan.jerk[joint][i] = phase.jerk as f64 / UNITS;
        plan.duration_s[joint][i] = phase.duration as f64 / TIME_UNITS;
    }
}
