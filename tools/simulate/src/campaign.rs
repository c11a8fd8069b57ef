//! Many runs on several threads, summed up in the order of their seeds.

use crate::kinds::{KIND_COUNT, KINDS};
use crate::oracle::Violation;
use crate::run::{Bug, Outcome, Run};
use crate::schedule::{self, Episode};
use crate::shrink;
use crate::subject::Subject;
use messages::Mode;
use report::in_parallel;
use std::collections::BTreeMap;

/// Number of failures whose schedules are shrunk. The others report the whole schedule.
const SHRUNK_MAX: usize = 8;

/// Ticks of all runs together for which every kind must fire `FIRINGS` times: 2,000 runs of 60,000 ticks.
const FULL: u64 = 2000 * 60_000;
/// Firings of every kind that `FULL` ticks require.
const FIRINGS: u64 = 1000;
/// From this many ticks on, the required firings are in proportion.
const PROPORTIONAL: u64 = FULL / 10;
/// Total ticks of all runs from which on every kind must fire at least once: 50 runs of 11,000 ticks.
const LEAST: u64 = SEEDS_LEAST * 11_000;
/// Number of runs that together deal every kind at least once. Each run deals three kinds.
const SEEDS_LEAST: u64 = 50;

#[derive(Clone, Debug, Default)]
pub struct Plan {
    pub first_seed: u64,
    pub seeds: u64,
    pub ticks: u64,
    pub jobs: usize,
    /// Stop at the first seed that breaks a promise.
    pub until_found: bool,
    /// Kinds that schedules may hold.
    pub kinds: Vec<usize>,
    /// The operator and the person are at another machine, see `remote.rs`.
    pub is_remote: bool,
    /// One camera sees the person, see `camera.rs`.
    pub is_camera: bool,
    /// A policy leads, see `policy.rs`.
    pub is_policy: bool,
    pub bug: Option<Bug>,
}

#[derive(Clone, Debug, PartialEq)]
pub struct Failure {
    pub seed: u64,
    /// The first promise that the run broke.
    pub violation: Violation,
    /// The smallest schedule that was found to break a promise, or the whole schedule.
    pub schedule: Vec<Episode>,
    /// True if a smaller schedule was searched for.
    pub shrunk: bool,
    /// The promise that `schedule` breaks, and when.
    pub smallest: Violation,
    /// Number of episodes of the schedule as it was drawn.
    pub episodes: usize,
}

#[derive(Clone, Debug, PartialEq)]
pub struct Summary {
    pub seeds: u64,
    pub ticks: u64,
    pub failures: Vec<Failure>,
    pub fired: [u64; KIND_COUNT],
    /// Allowed kinds that fired less often than `demanded`.
    pub missing: Vec<usize>,
    /// Firings that every allowed kind must reach.
    pub demanded: u64,
    pub ticks_in: [u64; Mode::ALL.len()],
    pub episodes: u64,
    pub transitions: u64,
    /// Longest time from the end of the faults until the robot follows again, ticks.
    pub back_after_max: u64,
    pub hash: u64,
}

impl Summary {
    /// Firings by hazard identity. A kind without an identity counts under its own name.
    pub fn by_id(&self) -> BTreeMap<&'static str, u64> {
        let mut out = BTreeMap::new();
        for (kind, count) in KINDS.iter().zip(self.fired) {
            let names = if kind.ids.is_empty() { std::slice::from_ref(&kind.name) } else { &kind.ids };
            for name in names {
                *out.entry(name.as_str()).or_insert(0) += count;
            }
        }
        out
    }

    pub fn holds(&self) -> bool {
        self.failures.is_empty() && self.missing.is_empty()
    }
}

/// Firings that every kind must reach in `seeds` runs of `ticks` ticks together. From 1.2e8 ticks on, it is
/// 1,000. Down to 1.2e7 ticks it is in proportion, because chance still averages out there. From 50 runs and
/// 5.5e5 ticks on, it is 1. Below that it is 0.
pub fn demanded(seeds: u64, ticks: u64) -> u64 {
    match ticks {
        _ if seeds < SEEDS_LEAST => 0,
        0..LEAST => 0,
        LEAST..PROPORTIONAL => 1,
        PROPORTIONAL..FULL => ticks * FIRINGS / FULL,
        FULL.. => FIRINGS,
    }
}

/// Runs a seed with a schedule. Every other seed begins engaged, as a branch of one run.
pub fn single(engaged: &Run<'_>, subject: &Subject, seed: u64, plan: &Plan, episodes: &[Episode]) -> Outcome {
    let run = if seed.is_multiple_of(2) { engaged.branch(seed) } else { Run::cold(subject, seed, plan.is_remote) };
    run.run(episodes, plan.ticks, plan.bug)
}

pub fn drawn(seed: u64, plan: &Plan) -> Vec<Episode> {
    schedule::draw(seed, plan.ticks, &plan.kinds, &schedule::dealt(seed, &plan.kinds))
}

/// Runs all seeds, or those up to the first that breaks a promise. The summary does not depend on the number of
/// threads. Calls `done` after every run.
pub fn run(subject: &Subject, plan: &Plan, done: impl Fn() + Sync) -> Result<Summary, String> {
    let engaged = subject.engaged(plan.is_remote)?;
    let last = plan.first_seed.checked_add(plan.seeds).ok_or("the last seed is too large")?;
    let at_once = if plan.until_found { plan.jobs } else { plan.seeds.max(1) as usize };
    let mut outcomes: Vec<(u64, usize, Outcome)> = vec![];
    for from in (plan.first_seed..last).step_by(at_once) {
        let count = at_once.min((last - from) as usize);
        outcomes.extend(in_parallel(plan.jobs, count, |n| {
            let seed = from + n as u64;
            let episodes = drawn(seed, plan);
            let outcome = single(&engaged, subject, seed, plan, &episodes);
            done();
            (seed, episodes.len(), outcome)
        }));
        if plan.until_found
            && let Some(found) = outcomes.iter().position(|(.., outcome)| outcome.violation.is_some())
        {
            outcomes.truncate(found + 1);
            break;
        }
    }
    let failed = outcomes.iter().filter_map(|(seed, _, outcome)| Some((*seed, outcome.violation.as_ref()?)));
    let failed: Vec<_> = failed.collect();
    let failures = in_parallel(plan.jobs, failed.len(), |n| {
        let (seed, violation) = failed[n];
        let episodes = drawn(seed, plan);
        let (count, violation, shrunk) = (episodes.len(), violation.clone(), n < SHRUNK_MAX && !plan.until_found);
        let fails = |some: &[Episode]| single(&engaged, subject, seed, plan, some).violation;
        let (schedule, smallest) =
            if shrunk { shrink::smallest(&episodes, &violation, fails) } else { (episodes, violation.clone()) };
        Failure { seed, violation, schedule, shrunk, smallest, episodes: count }
    });
    Ok(summed(plan, &outcomes, failures))
}

fn summed(plan: &Plan, outcomes: &[(u64, usize, Outcome)], failures: Vec<Failure>) -> Summary {
    let seeds = outcomes.len() as u64;
    let mut sum = Summary {
        seeds,
        ticks: 0,
        failures,
        fired: [0; KIND_COUNT],
        missing: vec![],
        demanded: demanded(seeds, seeds.saturating_mul(plan.ticks)),
        ticks_in: [0; Mode::ALL.len()],
        episodes: 0,
        transitions: 0,
        back_after_max: 0,
        hash: 0xcbf2_9ce4_8422_2325,
    };
    for (_, episodes, outcome) in outcomes {
        sum.ticks += outcome.ticks;
        sum.episodes += *episodes as u64;
        sum.transitions += outcome.transitions.len() as u64;
        sum.back_after_max = sum.back_after_max.max(outcome.back_after.unwrap_or(0));
        sum.hash = (sum.hash ^ outcome.hash).wrapping_mul(0x0000_0100_0000_01b3);
        sum.fired.iter_mut().zip(outcome.fired).for_each(|(sum, count)| *sum += count);
        sum.ticks_in.iter_mut().zip(outcome.ticks_in).for_each(|(sum, count)| *sum += count);
    }
    sum.missing = plan.kinds.iter().copied().filter(|&kind| sum.fired[kind] < sum.demanded).collect();
    sum
}
