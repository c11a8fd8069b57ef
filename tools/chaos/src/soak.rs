//! Runs the real processes for hours, engaged and following, with a fault once a minute. Watches everything
//! that may grow: memory, file descriptors, threads, segments. A stop that no fault explains is a false stop.

use crate::cli::SoakArgs;
use crate::figures::TrialFigures;
use crate::injection::{Injection, Target};
use crate::rig::Rig;
use crate::trial::{self, Outcome};
use messages::{Mode, Status};
use rand::SeedableRng;
use rand_pcg::Pcg64Mcg;
use rt::{Failure, Shutdown};
use serde::Serialize;
use serde_json::{Map, Value, json};
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::time::{Duration, Instant};
use teleopd::PROCESSES;

/// Time between two looks at the processes.
const LOOK: Duration = Duration::from_secs(1);
/// Largest growth of a process's resident memory from `WARM_AFTER` to the end, KiB. Its pages are locked and
/// touched before READY. Only pages of the allocator remain, which the thread beside the loop fills once.
const GROWTH_MAX_KIB: u64 = 512;
/// Time after which a process counts as warm: a tenth of a minute.
const WARM_AFTER: Duration = Duration::from_secs(6);
/// Targets in sequence, and true if the target is killed. Control and driver live through the whole soak, so
/// that a slow leak shows. They are suspended instead, unless all are killed.
const TURNS: [(Target, bool); 6] = [
    (Target::Ingest, true),
    (Target::Control, false),
    (Target::Retarget, true),
    (Target::Client, true),
    (Target::Driver, false),
    (Target::Operator, true),
];

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
struct Holding {
    resident_kib: u64,
    descriptors: u64,
    threads: u64,
}

impl Holding {
    fn read(id: u32) -> Option<Self> {
        let status = std::fs::read_to_string(format!("/proc/{id}/status")).ok()?;
        let number = |key: &str| {
            let line = status.lines().find_map(|line| line.strip_prefix(key)?.strip_prefix(':'));
            line?.split_whitespace().next()?.parse().ok()
        };
        let descriptors = std::fs::read_dir(format!("/proc/{id}/fd")).ok()?.count() as u64;
        Some(Self { resident_kib: number("VmRSS")?, descriptors, threads: number("Threads")? })
    }

    fn each_with(self, other: Self, of: impl Fn(u64, u64) -> u64) -> Self {
        Self {
            resident_kib: of(self.resident_kib, other.resident_kib),
            descriptors: of(self.descriptors, other.descriptors),
            threads: of(self.threads, other.threads),
        }
    }
}

/// Resources of one life of a process: those when it was warm, and the largest since.
#[derive(Clone, Copy, Debug)]
struct Life {
    id: u32,
    since: Instant,
    warm: Option<Holding>,
    most: Holding,
}

#[derive(Debug, Default)]
pub struct Soaked {
    seconds: f64,
    engaged_s: f64,
    lives: BTreeMap<&'static str, Life>,
    /// The largest growth of any life, by process.
    growth: BTreeMap<&'static str, Holding>,
    segments_first: usize,
    segments_last: usize,
    false_stops: Vec<String>,
    figures: TrialFigures,
    reports: Map<String, Value>,
}

pub fn run(options: &SoakArgs, shutdown: &Shutdown) -> Result<Soaked, Failure> {
    let (length, every) = (options.hours * 3600.0, Duration::from_secs_f64(options.strike_every));
    let length = Duration::from_secs_f64(length);
    let mut rig = Rig::start(&options.common.config)?;
    let mut dice = Pcg64Mcg::seed_from_u64(1);
    let (mut soaked, mut outcomes) = (Soaked::default(), Vec::new());
    trial::engage(&mut rig, Target::Ingest, Mode::Engaged)?;
    let begun = Instant::now();
    loop {
        clean(&mut rig, &mut soaked, begun, (begun.elapsed() + every).min(length), shutdown);
        if begun.elapsed() >= length || shutdown.requested() {
            break;
        }
        let (target, kill) = TURNS[outcomes.len() % TURNS.len()];
        let kill = kill || options.kill_all;
        let fault = Injection::draw(target, kill, 1.0, &mut dice);
        if let Err(failure) = strike(&mut rig, fault, &mut outcomes) {
            // The results until then are still reported.
            soaked.figures.add_trouble(format!("after {fault:?}: {failure}"));
            break;
        }
        let held = if kill { "killed" } else { "suspended" };
        eprintln!("{:.0} s: {} was {held}", begun.elapsed().as_secs_f64(), target.name());
    }
    if let Err(failure) = rig.clear() {
        soaked.figures.add_trouble(failure.text);
    }
    soaked.segments_last = segments(&rig);
    soaked.seconds = begun.elapsed().as_secs_f64();
    soaked.reports = soaked.figures.conclude(rig, &outcomes);
    Ok(soaked)
}

/// Injects a fault, and follows the person again.
fn strike(rig: &mut Rig, fault: Injection, outcomes: &mut Vec<Outcome>) -> Result<(), Failure> {
    outcomes.push(trial::run(rig, fault)?);
    trial::engage(rig, Target::Ingest, Mode::Engaged)
}

/// Follows the person, engaged, for `until` after the begin. Every stop in this time is a false one.
fn clean(rig: &mut Rig, soaked: &mut Soaked, begun: Instant, until: Duration, shutdown: &Shutdown) {
    let first = segments(rig);
    soaked.segments_first = if soaked.segments_first == 0 { first } else { soaked.segments_first };
    let engaged = Instant::now();
    let mut counted = rig.operator.status().map_or(0, |status| status.transition_count);
    while begun.elapsed() < until && !shutdown.requested() {
        std::thread::sleep(LOOK.min(until.saturating_sub(begun.elapsed())));
        for name in PROCESSES {
            soaked.look(name, rig.harness.children.id(name));
        }
        soaked.count_stops(begun.elapsed(), rig.operator.status(), &mut counted);
    }
    soaked.engaged_s += engaged.elapsed().as_secs_f64();
    rig.release();
}

fn segments(rig: &Rig) -> usize {
    rig.harness.instance.shared_memory().count()
}

impl Soaked {
    /// Adds the transitions after number `counted` that left Engaged. A stop counts even if the robot continued by
    /// itself.
    fn count_stops(&mut self, at: Duration, status: Option<Status>, counted: &mut u32) {
        let Some(status) = status else {
            return self.false_stops.push(format!("{:.0} s: no answer", at.as_secs_f64()));
        };
        for transition in explain::newest_transitions(&status, status.transition_count.saturating_sub(*counted)) {
            if transition.from == Mode::Engaged as u32 {
                self.false_stops.push(format!("{:.0} s: {}", at.as_secs_f64(), transition.why_name()));
            }
        }
        *counted = status.transition_count;
    }

    fn look(&mut self, name: &'static str, id: Option<u32>) {
        let Some((id, holding)) = id.and_then(|id| Some((id, Holding::read(id)?))) else { return };
        let born = Life { id, since: Instant::now(), warm: None, most: holding };
        let life = self.lives.entry(name).or_insert(born);
        if life.id != id {
            *life = born;
        }
        if life.warm.is_none() && life.since.elapsed() > WARM_AFTER {
            (life.warm, life.most) = (Some(holding), holding);
        }
        let Some(warm) = life.warm else { return };
        life.most = life.most.each_with(holding, u64::max);
        let most = self.growth.entry(name).or_default();
        *most = most.each_with(life.most.each_with(warm, |most, warm| most - warm), u64::max);
    }

    /// Returns everything that must not have happened.
    pub fn complaints(&self) -> Vec<String> {
        [self.figures.complaints(), self.own_complaints()].concat()
    }

    fn own_complaints(&self) -> Vec<String> {
        let stops = self.false_stops.iter().map(|stop| format!("a stop that no injected fault explains, {stop}"));
        let mut complaints: Vec<_> = stops.collect();
        for (name, grown) in &self.growth {
            if grown.resident_kib > GROWTH_MAX_KIB {
                complaints.push(format!("{name} grew by {} KiB, more than {GROWTH_MAX_KIB}", grown.resident_kib));
            }
            for (what, count) in [("descriptors", grown.descriptors), ("threads", grown.threads)] {
                if count > 0 {
                    complaints.push(format!("{name} has {count} {what} more than after its warm-up"));
                }
            }
        }
        if self.segments_last > self.segments_first {
            let (last, first) = (self.segments_last, self.segments_first);
            complaints.push(format!("{last} segments at the end, {first} at the start"));
        }
        complaints
    }

    pub fn to_json(&self) -> Value {
        json!({
            "seconds": self.seconds,
            "engaged_s": self.engaged_s,
            "false_stops": self.false_stops,
            "growth": self.growth,
            "segments": { "first": self.segments_first, "last": self.segments_last },
            "trials": self.figures.to_json(),
            "processes": self.reports,
            "complaints": self.complaints(),
        })
    }

    pub fn text(&self) -> String {
        let mut out = self.figures.text();
        // Writing to a String cannot fail.
        let _ = writeln!(out, "{:.0} s, {:.0} s of them engaged and clean", self.seconds, self.engaged_s);
        for (name, grown) in &self.growth {
            let Holding { resident_kib, descriptors, threads } = grown;
            let _ =
                writeln!(out, "{name:<10} grew by {resident_kib} KiB, {descriptors} descriptors, {threads} threads");
        }
        let _ = writeln!(out, "segments: {} at first, {} at last", self.segments_first, self.segments_last);
        let _ = writeln!(out, "false stops: {}", self.false_stops.len());
        for complaint in self.own_complaints() {
            let _ = writeln!(out, "BROKEN: {complaint}");
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use messages::{Fault, Layout, Transition};

    #[test]
    fn process_holdings_are_read_from_proc() {
        let own = Holding::read(std::process::id()).expect("this process exists");
        assert!(own.resident_kib > 100 && own.descriptors >= 3 && own.threads >= 1, "{own:?}");
        assert_eq!(Holding::read(u32::MAX), None);
    }

    #[test]
    fn false_stop_is_counted_once_with_its_cause() {
        let mut status: Status = Layout::ZERO;
        let step =
            |from: Mode, to: Mode, why: u32| Transition { from: from as u32, to: to as u32, why, ..Layout::ZERO };
        status.transitions[0] = step(Mode::Engaging, Mode::Engaged, Transition::ALIGNED);
        status.transitions[1] = step(Mode::Engaged, Mode::Holding, Fault::TargetStale as u32);
        status.transitions[2] = step(Mode::Holding, Mode::Engaging, Transition::CLEARED);
        status.transition_count = 3;
        let (mut soaked, mut counted) = (Soaked::default(), 1);
        soaked.count_stops(Duration::from_secs(7), Some(status), &mut counted);
        soaked.count_stops(Duration::from_secs(8), Some(status), &mut counted);
        assert_eq!(soaked.false_stops, ["7 s: TargetStale"]);
    }

    #[test]
    fn growth_false_stop_and_broken_trial_become_complaints() {
        let mut soaked = Soaked { segments_first: 10, segments_last: 10, ..Soaked::default() };
        soaked.growth.insert("driver", Holding { resident_kib: GROWTH_MAX_KIB, descriptors: 0, threads: 0 });
        assert!(soaked.complaints().is_empty());
        soaked.growth.insert("driver", Holding { resident_kib: GROWTH_MAX_KIB + 1, descriptors: 1, threads: 2 });
        soaked.segments_last = 11;
        soaked.false_stops.push("12 s: Holding TargetStale".into());
        soaked.figures.add_trouble("no rest".into());
        let complaints = soaked.complaints().join("; ");
        for part in
            ["grew by 513", "1 descriptors", "2 threads", "11 segments", "no injected fault explains", "no rest"]
        {
            assert!(complaints.contains(part), "{part}: {complaints}");
        }
    }
}
