//! Sums up the results of the trials.

use crate::injection::{Kind, Target};
use crate::monitor::Seen;
use crate::rig::Rig;
use crate::trial::Outcome;
use checker::ViolationKind;
use config::Settings;
use report::table::{self, column};
use serde_json::{Map, Value, json};
use std::collections::BTreeMap;
use std::fmt::Write as _;

#[derive(Clone, Debug, Default)]
struct TargetFigures {
    kills: u64,
    suspends: u64,
    moving: u64,
    not_rested: u64,
    late: u64,
    bound_ticks: u64,
    rest_after_ticks: Vec<u64>,
}

/// True if the robot is the simulated one, which keeps a record. Nobody here can judge another one.
pub(crate) fn has_robot(settings: &Settings) -> bool {
    settings.driver.program.is_empty()
}

#[derive(Clone, Debug, Default)]
pub struct TrialFigures {
    targets: BTreeMap<Target, TargetFigures>,
    /// Violations that the monitor saw, by kind.
    witnessed: [u64; ViolationKind::ALL.len()],
    states: u64,
    not_finite: u64,
    moved_without_enable: u64,
    /// Violations that the driver recorded itself, by kind.
    recorded: [u64; ViolationKind::ALL.len()],
    records: u64,
    /// Violations that the judge of the joints' true motion recorded, by kind, and the first of each robot.
    judged: [u64; plant::ViolationKind::ALL.len()],
    judged_first: Vec<Value>,
    robots: u64,
    oldest_command_us: f64,
    clients_begun_anew: u64,
    trouble: Vec<String>,
}

impl TrialFigures {
    /// Ends an instance. Adds its trials, and what its monitor and its processes saw. Returns the reports of the
    /// processes.
    pub fn conclude(&mut self, rig: Rig, outcomes: &[Outcome]) -> Map<String, Value> {
        self.add_seen(&rig.monitor.seen());
        self.clients_begun_anew += rig.clients_begun_anew;
        let settings = rig.settings.clone();
        let (trouble, reports) = rig.end();
        // With real-time scheduling, no stale time was relaxed.
        let realtime = reports.get(Target::Control.name()).is_some_and(|control| control["realtime"] == true);
        let factor = if realtime { 1.0 } else { settings.safety.stale_factor_without_realtime };
        for outcome in outcomes {
            self.add(outcome, outcome.fault.target.rest_within_ticks(&settings.safety, factor));
        }
        match reports.get(Target::Driver.name()) {
            Some(record) => self.add_record(record),
            None => self.trouble.push("a driver wrote no record".to_owned()),
        }
        match reports.get("robot") {
            Some(record) if has_robot(&settings) => self.add_robot(record),
            None if has_robot(&settings) => self.trouble.push("a robot wrote no record".to_owned()),
            _ => {}
        }
        self.trouble.extend(trouble);
        reports
    }

    /// Adds a trial, in which the robot had to be at rest after `bound_ticks`.
    fn add(&mut self, outcome: &Outcome, bound_ticks: u64) {
        let of = self.targets.entry(outcome.fault.target).or_default();
        match outcome.fault.kind {
            Kind::Kill { .. } => of.kills += 1,
            Kind::Suspend { .. } => of.suspends += 1,
        }
        of.moving += u64::from(outcome.moving);
        of.not_rested += u64::from(!outcome.rested);
        of.late += u64::from(outcome.rest_after_ticks.is_some_and(|ticks| ticks > bound_ticks));
        of.bound_ticks = bound_ticks;
        of.rest_after_ticks.extend(outcome.rest_after_ticks);
        if !outcome.rested {
            self.trouble.push(format!("no rest after {:?}", outcome.fault));
        }
    }

    fn add_seen(&mut self, seen: &Seen) {
        self.states += seen.states;
        self.not_finite += seen.not_finite;
        self.moved_without_enable += seen.moved_without_enable;
        self.witnessed.iter_mut().zip(seen.violations).for_each(|(sum, count)| *sum += count);
    }

    fn add_record(&mut self, record: &Value) {
        self.records += 1;
        let kinds = ViolationKind::NAMES;
        self.trouble.extend(add_counts(&mut self.recorded, kinds, record, "driver"));
        let oldest_us = record["oldest_command_us"].as_f64().unwrap_or(f64::INFINITY);
        self.oldest_command_us = self.oldest_command_us.max(oldest_us);
    }

    fn add_robot(&mut self, record: &Value) {
        self.robots += 1;
        let kinds = plant::ViolationKind::NAMES;
        self.trouble.extend(add_counts(&mut self.judged, kinds, record, "robot"));
        if !record["first_violation"].is_null() {
            self.judged_first.push(record["first_violation"].clone());
        }
    }

    pub fn add_trouble(&mut self, trouble: String) {
        self.trouble.push(trouble);
    }

    pub fn kills(&self) -> u64 {
        self.targets.values().map(|of| of.kills).sum()
    }

    pub fn suspends(&self) -> u64 {
        self.targets.values().map(|of| of.suspends).sum()
    }

    /// Returns everything that must not have happened. A late rest is reported but not judged, because it
    /// depends on this machine's timing.
    pub fn complaints(&self) -> Vec<String> {
        let mut complaints = self.trouble.clone();
        let mut zero = |what: String, count: u64| {
            if count > 0 {
                complaints.push(format!("{count} {what}"));
            }
        };
        for (kind, (witnessed, recorded)) in ViolationKind::ALL.iter().zip(self.witnessed.iter().zip(self.recorded)) {
            zero(format!("{} violations were witnessed", kind.name()), *witnessed);
            zero(format!("{} violations are in the driver's record", kind.name()), recorded);
        }
        for (kind, count) in plant::ViolationKind::ALL.iter().zip(self.judged) {
            zero(format!("{} violations of the joints' true motion", kind.name()), count);
        }
        zero("states were not finite".into(), self.not_finite);
        zero("states moved without an enable".into(), self.moved_without_enable);
        for (target, of) in &self.targets {
            zero(format!("faults of {} were not followed by rest", target.name()), of.not_rested);
        }
        complaints
    }

    pub fn to_json(&self) -> Value {
        let targets = self.targets.iter().map(|(target, of)| {
            let mut ticks = of.rest_after_ticks.clone();
            ticks.sort_unstable();
            let value = json!({
                "kills": of.kills,
                "suspends": of.suspends,
                "moving": of.moving,
                "rests": ticks.len(),
                "not_rested": of.not_rested,
                "rest_after_ticks": { "p50": ticks.get(ticks.len() / 2), "max": ticks.last() },
                "bound_ticks": of.bound_ticks,
                "beyond_bound": of.late,
            });
            (target.name().to_owned(), value)
        });
        let kinds = ViolationKind::NAMES;
        json!({
            "kills": self.kills(),
            "suspends": self.suspends(),
            "victims": targets.collect::<Map<_, _>>(),
            "states_witnessed": self.states,
            "violations_witnessed": named(kinds, self.witnessed),
            "violations_recorded": named(kinds, self.recorded),
            "violations_of_true_motion": named(plant::ViolationKind::NAMES, self.judged),
            "first_violations_of_true_motion": self.judged_first,
            "robot_records": self.robots,
            "driver_records": self.records,
            "oldest_command_us": self.oldest_command_us,
            "not_finite": self.not_finite,
            "moved_without_enable": self.moved_without_enable,
            "clients_begun_anew": self.clients_begun_anew,
            "complaints": self.complaints(),
        })
    }

    pub fn text(&self) -> String {
        let value = self.to_json();
        let mut out = format!("{} kills, {} suspensions\n", self.kills(), self.suspends());
        let count =
            |head, width, key: &'static str| column(["", head], width, move |figures: &Value| figures[key].to_string());
        let rest = |head, width, key: &'static str| {
            column(["", head], width, move |figures: &Value| ticks(&figures["rest_after_ticks"][key]))
        };
        let columns = [
            count("kills", 6, "kills"),
            count("suspends", 8, "suspends"),
            count("moving", 7, "moving"),
            count("rests", 6, "rests"),
            rest("to rest: p50", 13, "p50"),
            rest("max", 10, "max"),
            count("late", 6, "beyond_bound"),
            column(["", "bound"], 10, |figures: &Value| ticks(&figures["bound_ticks"])),
        ];
        let rows = value["victims"].as_object().into_iter().flatten().map(|(name, figures)| (name.as_str(), figures));
        // Writing to a String cannot fail.
        let _ = table::write(&mut out, ("", 10), &columns, rows);
        let _ = writeln!(out, "witnessed {} states: violations {}", self.states, value["violations_witnessed"]);
        let _ = writeln!(out, "{} records of drivers: violations {}", self.records, value["violations_recorded"]);
        let _ = writeln!(
            out,
            "{} records of robots: violations of the joints' true motion {}",
            self.robots, value["violations_of_true_motion"]
        );
        let _ = writeln!(out, "oldest command executed {:.0} us after its deadline", self.oldest_command_us);
        let _ = writeln!(out, "states moved without an enable: {}", self.moved_without_enable);
        let _ = writeln!(out, "clients that ended and were restarted: {}", self.clients_begun_anew);
        for complaint in self.complaints() {
            let _ = writeln!(out, "BROKEN: {complaint}");
        }
        out
    }
}

/// Formats a number of ticks. It is absent if the robot never moved and so had nothing to stop.
fn ticks(count: &Value) -> String {
    count.as_u64().map_or("-".to_owned(), |count| format!("{count} ticks"))
}

fn named<const N: usize>(names: [&'static str; N], counts: [u64; N]) -> Value {
    Value::Object(names.into_iter().zip(counts).map(|(name, count)| (name.to_owned(), json!(count))).collect())
}

/// Adds the counts of a record. Returns a complaint for each that is missing.
fn add_counts<const N: usize>(sums: &mut [u64; N], kinds: [&str; N], record: &Value, whose: &str) -> Vec<String> {
    let mut missing = Vec::new();
    for (sum, kind) in sums.iter_mut().zip(kinds) {
        match record["violations"][kind].as_u64() {
            Some(count) => *sum += count,
            None => missing.push(format!("the {whose}'s record does not count {kind}")),
        }
    }
    missing
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::injection::Injection;
    use std::time::Duration;

    fn outcome(target: Target, rest_after_ticks: Option<u64>) -> Outcome {
        let kind = Kind::Kill { held_on: Duration::ZERO };
        let fault = Injection { target, kind, engaged: false, phase: Duration::ZERO };
        Outcome { fault, moving: true, rest_after_ticks, rested: rest_after_ticks.is_some() }
    }

    #[test]
    fn each_forbidden_outcome_becomes_a_complaint() {
        let mut figures = TrialFigures::default();
        figures.add(&outcome(Target::Control, Some(40)), 752);
        assert!(figures.complaints().is_empty());
        figures.add(&outcome(Target::Ingest, None), 902);
        figures.add_seen(&Seen { moved_without_enable: 1, violations: [0, 2, 0, 0, 0, 0, 0], ..Seen::default() });
        figures.add_record(&json!({ "violations": { "position": 3, "velocity": 0, "acceleration": 0, "jerk": 0 } }));
        let complaints = figures.complaints();
        for part in ["ingest were not", "1 states moved", "2 velocity", "3 position", "does not count clearance"] {
            assert!(complaints.iter().any(|one| one.contains(part)), "{part}: {complaints:?}");
        }
    }

    #[test]
    fn late_rest_is_counted_but_is_no_complaint() {
        let mut figures = TrialFigures::default();
        figures.add(&outcome(Target::Control, Some(753)), 752);
        assert_eq!(figures.to_json()["victims"]["control"]["beyond_bound"], 1);
        assert!(figures.complaints().is_empty());
    }

    #[test]
    fn summary_line_names_ticks_and_shows_missing_times_as_dash() {
        let mut figures = TrialFigures::default();
        figures.add(&outcome(Target::Ingest, None), 902);
        let text = figures.text();
        let line = text.lines().find(|line| line.starts_with("ingest")).expect("a line");
        let cells: Vec<_> = line.split_whitespace().collect();
        assert_eq!(cells, ["ingest", "1", "0", "1", "0", "-", "-", "0", "902", "ticks"], "{text}");
    }
}
