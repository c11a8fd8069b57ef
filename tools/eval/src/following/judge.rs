//! Measures the robot's distance from the person.

use super::expectation::{self, AHEAD_MS};
use super::hands::HandError;
use super::play::{Played, Sample};
use crate::clips::Human;
use crate::methods::limbs_of;
use messages::{LIMBS, Stamp};
use retarget::{ArmModel, limb_error_deg};
use serde::Serialize;
use std::collections::BTreeMap;

/// Delays among which the best one is searched, ms: every 20 up to this.
const BEST_MAX_MS: u64 = 600;
const BEST_STEP_MS: usize = 20;

/// Measurements of one clip. Serialized, they are the numbers with one value each.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct ClipFigures {
    #[serde(skip)]
    pub name: String,
    pub seconds: f64,
    /// Error against the person of the same instant, degrees.
    pub now_deg: f64,
    /// Error against the person so many ms before, in the order of the requested delays.
    #[serde(skip)]
    pub at_deg: Vec<f64>,
    /// Least error over all delays, degrees.
    pub best_deg: f64,
    pub best_ms: f64,
    /// Share of the person's hands that the robot's could take without coming near anything.
    pub hands_free: Option<f64>,
    /// Mean error of the free hands, degrees.
    pub hands_deg: Option<f64>,
    /// The least that the wrists could reach from the commanded forearms, degrees.
    pub hands_optimum_deg: Option<f64>,
    /// Mean error of the best motion that knows the person's hand no farther ahead than the following delay, degrees.
    pub hands_known_deg: Option<f64>,
    /// Mean error of the expectation, at each of `AHEAD_MS` beyond the newest skeleton.
    #[serde(skip)]
    pub expected_deg: [Option<f64>; AHEAD_MS.len()],
    pub torque_share_max: f64,
    /// Share of ticks whose command was the next point of the previous plan.
    pub on_plan_share: f64,
    #[serde(skip)]
    pub violations: BTreeMap<String, u64>,
    #[serde(skip)]
    pub stopped: Option<String>,
}

impl ClipFigures {
    pub fn violations_total(&self) -> u64 {
        self.violations.values().sum()
    }
}

pub fn limbs_deg(robot: &Human, person: &Human) -> f64 {
    let both = robot.iter().zip(person).flat_map(|(robot, person)| limb_error_deg(robot, person));
    both.sum::<f64>() / LIMBS as f64
}

/// Returns the error of each sample of a span against the person `delay_ms` before, with the time of each. It
/// begins with the first sample whose person belongs to the span too.
pub fn errors_deg(arms: [&ArmModel; 2], played: &Played, span: &[Sample], delay_ms: f64) -> Vec<(Stamp, f64)> {
    let delay_ns = (delay_ms * 1e6).round() as u64;
    let Some(first) = span.first() else { return Vec::new() };
    let error = |sample: &Sample| {
        let then = Stamp(sample.at.0.checked_sub(delay_ns)?);
        let person = played.person.at(then).filter(|_| then >= first.at)?;
        let robot = limbs_of(arms, &sample.q);
        let person = std::array::from_fn(|side| robot[side].target(&person[side], arms[side].rolls));
        Some((sample.at, limbs_deg(&robot, &person)))
    };
    span.iter().filter_map(error).collect()
}

pub(super) fn mean_deg(arms: [&ArmModel; 2], played: &Played, delay_ms: f64) -> Option<f64> {
    let all: Vec<f64> =
        played.spans.iter().flat_map(|span| errors_deg(arms, played, span, delay_ms)).map(|(_, deg)| deg).collect();
    mean(&all)
}

pub(crate) fn mean(values: &[f64]) -> Option<f64> {
    (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
}

/// Returns the figures of a clip. None if the robot was never Engaged for long enough to compare at every
/// requested delay.
pub fn judge(arms: [&ArmModel; 2], played: &Played, delays_ms: &[f64]) -> Option<ClipFigures> {
    let now_deg = mean_deg(arms, played, 0.0)?;
    let at_deg: Option<Vec<f64>> = delays_ms.iter().map(|&delay| mean_deg(arms, played, delay)).collect();
    // A delay beyond half of the clip would be judged by little of it.
    let samples: usize = played.spans.iter().map(Vec::len).sum();
    let most_ms = BEST_MAX_MS.min(samples as u64 * 10);
    let tried = (0..=most_ms).step_by(BEST_STEP_MS).map(|ms| ms as f64);
    let tried = tried.filter_map(|ms| mean_deg(arms, played, ms).map(|deg| (deg, ms)));
    let (best_deg, best_ms) = tried.reduce(|a, b| if b.0 < a.0 { b } else { a })?;
    let free: Vec<&HandError> = played.hands.iter().filter(|hand| hand.free).collect();
    let hands = |of: fn(&HandError) -> f64| mean(&free.iter().map(|hand| of(hand)).collect::<Vec<_>>());
    Some(ClipFigures {
        name: played.name.clone(),
        seconds: played.ticks as f64 * messages::TICK_S,
        now_deg,
        at_deg: at_deg?,
        best_deg,
        best_ms,
        hands_free: (!played.hands.is_empty()).then(|| free.len() as f64 / played.hands.len() as f64),
        hands_deg: hands(|hand| hand.command_deg),
        hands_optimum_deg: hands(|hand| hand.optimum_deg),
        hands_known_deg: hands(|hand| hand.known_deg),
        expected_deg: expectation::errors_deg(&played.expected, &played.person),
        torque_share_max: played.torque_share_max,
        on_plan_share: played.on_plan as f64 / played.ticks as f64,
        violations: played.violations.clone(),
        stopped: played.stopped.clone(),
    })
}
