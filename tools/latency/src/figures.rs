//! Figures that all blocks of one variant measured together.

use crate::distribution::Distribution;
use crate::processes::Outcome;
use rt::{Exit, Failure};
use serde::Deserialize;
use serde_json::{Map, Value, json};
use std::collections::BTreeMap;

/// Hops in the order of the path, end to end last: the metric, and the process that reports it.
pub const HOPS: [(&str, &str); 9] = [
    ("published_to_ingest", "ingest"),
    ("ingest_work", "ingest"),
    ("ingest_to_retarget", "retarget"),
    ("retarget_work", "retarget"),
    ("target_to_control", "control"),
    ("control_work", "control"),
    ("command_to_driver", "driver"),
    ("skeleton_to_command", "driver"),
    ("target_to_command", "driver"),
];
/// Loops whose wake-ups are reported, with their process.
pub const LOOPS: [(&str, &str); 3] = [("retarget", "retarget"), ("control", "control"), ("driver", "driver")];

/// Allocations after READY.
#[derive(Clone, Copy, Debug, Default, Deserialize)]
pub struct Allocations {
    /// Those of the loop's thread, without those of the transport.
    pub r#loop: u64,
    /// Those of the transport in publishing.
    pub transport: u64,
}

/// Report of a process about itself, over all blocks.
#[derive(Clone, Debug, Default, Deserialize)]
pub struct Process {
    pub allocations: Allocations,
    /// Page faults after READY that waited for a disk.
    pub major_faults: u64,
    /// Page faults of the loop's thread after READY that were served from memory.
    pub loop_minor_faults: u64,
    /// Processor time since READY, s.
    pub cpu_s: f64,
    /// Slowest cold start until READY, ms.
    pub ready_after_ms: f64,
    /// Samples that were dropped on their way out of the loop because the ring was full.
    pub ring_dropped: u64,
    /// Real-time properties that the system granted in the last block.
    pub realtime: Vec<String>,
}

/// The report that a process writes at its end.
#[derive(Deserialize)]
struct Reported {
    telemetry: Telemetry,
    /// Skeletons that `ingest` accepted.
    accepted: Option<u64>,
}

#[derive(Deserialize)]
struct Telemetry {
    metrics: BTreeMap<String, Distribution>,
    #[serde(flatten)]
    process: Process,
}

#[derive(Clone, Debug, Default)]
pub struct VariantFigures {
    hops: Vec<Distribution>,
    wake_ups: Vec<Distribution>,
    pub processes: Vec<(&'static str, Process)>,
    pub missed: [u64; 3],
    pub ticks: [u64; 3],
    pub published: u64,
    pub accepted: u64,
    /// Time between READY and release, s.
    pub wall_s: f64,
    pub blocks: u64,
}

impl VariantFigures {
    /// Merges the blocks of one variant.
    pub fn merge(outcomes: &[Outcome]) -> Result<Self, Failure> {
        let mut all = Self {
            hops: vec![Distribution::default(); HOPS.len()],
            wake_ups: vec![Distribution::default(); LOOPS.len()],
            ..Self::default()
        };
        let invalid = Failure::with(Exit::Failed);
        for outcome in outcomes {
            all.add(outcome).map_err(&invalid)?;
        }
        let empty = HOPS.iter().zip(&all.hops).find(|(_, distribution)| distribution.count() == 0);
        let Some(((hop, process), _)) = empty else { return Ok(all) };
        Err(invalid(format!("{process} counted no {hop}")))
    }

    fn add(&mut self, outcome: &Outcome) -> Result<(), String> {
        for (name, report) in &outcome.processes {
            let Reported { telemetry: Telemetry { metrics, process }, accepted } =
                Reported::deserialize(report).map_err(|error| format!("{name}: {error}"))?;
            let find = |metric: &str| metrics.get(metric).ok_or(format!("{name}: {metric} is missing"));
            for ((hop, _), merged) in HOPS.iter().zip(&mut self.hops).filter(|((_, process), _)| process == name) {
                merged.merge(find(hop)?);
            }
            for (_, merged) in LOOPS.iter().zip(&mut self.wake_ups).filter(|((_, process), _)| process == name) {
                merged.merge(find("wake_up")?);
            }
            match self.processes.iter_mut().find(|(known, _)| known == name) {
                Some((_, before)) => before.add(process),
                None => self.processes.push((name, process)),
            }
            if *name == "ingest" {
                self.accepted += accepted.ok_or("ingest: accepted is missing")?;
            }
        }
        for (i, (name, _)) in LOOPS.iter().enumerate() {
            let count = |key: &str| outcome.run[key][*name].as_u64().ok_or(format!("the run has no {key}.{name}"));
            self.missed[i] += count("missed_deadlines")?;
            self.ticks[i] += count("ticks")?;
        }
        self.published += outcome.published;
        self.wall_s += outcome.wall_s;
        self.blocks += 1;
        Ok(())
    }

    pub fn hop(&self, name: &str) -> &Distribution {
        let index = HOPS.iter().position(|(hop, _)| *hop == name).expect("one of the hops");
        &self.hops[index]
    }

    pub fn hops(&self) -> impl Iterator<Item = (&'static str, &Distribution)> {
        HOPS.iter().map(|(name, _)| *name).zip(&self.hops)
    }

    pub fn wake_ups(&self) -> impl Iterator<Item = (&'static str, &Distribution)> {
        LOOPS.iter().map(|(name, _)| *name).zip(&self.wake_ups)
    }

    /// Returns the wake-ups of retarget, whose deadline is the tick itself.
    pub fn wake_up(&self) -> &Distribution {
        &self.wake_ups[0]
    }

    /// Returns the total of a count over all processes.
    pub fn total(&self, of: impl Fn(&Process) -> u64) -> u64 {
        self.processes.iter().map(|(_, process)| of(process)).sum()
    }

    pub fn to_json(&self) -> Value {
        let table = |rows: Vec<(&'static str, &Distribution)>| {
            let rows = rows.into_iter().filter_map(|(name, all)| Some((name.to_owned(), all.to_json()?)));
            Value::Object(rows.collect::<Map<_, _>>())
        };
        let by_loop = |counts: &[u64; 3]| -> Value {
            Value::Object(
                LOOPS.iter().zip(counts).map(|((name, _), count)| ((*name).to_owned(), json!(count))).collect(),
            )
        };
        let processes: Map<_, _> =
            self.processes.iter().map(|(name, one)| ((*name).to_owned(), one.to_json(self.wall_s))).collect();
        json!({
            "hops_us": table(self.hops().collect()),
            "wake_up_us": table(self.wake_ups().collect()),
            "ticks": by_loop(&self.ticks),
            "missed_deadlines": by_loop(&self.missed),
            "skeletons_published": self.published,
            "skeletons_accepted": self.accepted,
            "processes": processes,
            "blocks": self.blocks,
            "seconds": self.wall_s,
        })
    }
}

impl Process {
    fn add(&mut self, next: Self) {
        self.allocations.r#loop += next.allocations.r#loop;
        self.allocations.transport += next.allocations.transport;
        self.major_faults += next.major_faults;
        self.loop_minor_faults += next.loop_minor_faults;
        self.ring_dropped += next.ring_dropped;
        self.cpu_s += next.cpu_s;
        self.ready_after_ms = self.ready_after_ms.max(next.ready_after_ms);
        self.realtime = next.realtime;
    }

    fn to_json(&self, wall_s: f64) -> Value {
        json!({
            "cpu": self.cpu_s / wall_s,
            "ready_after_ms": self.ready_after_ms,
            "allocations_after_ready": self.allocations.r#loop,
            "transport_allocations_after_ready": self.allocations.transport,
            "major_faults_after_ready": self.major_faults,
            "loop_minor_faults_after_ready": self.loop_minor_faults,
            "ring_dropped": self.ring_dropped,
            "realtime": self.realtime,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::blocks::Kind;

    fn record(ns: u64) -> Value {
        json!({ "buckets": [[ns, 10]], "max_us": ns as f64 * 1e-3, "seconds": [[1.0, 10, 1.0, 1.0, 1.0]] })
    }

    fn outcome(ns: u64) -> Outcome {
        let processes = teleopd::PROCESSES.map(|name| {
            let mut metrics = Map::new();
            metrics.insert("wake_up".into(), record(ns));
            for (metric, _) in HOPS.iter().filter(|(_, process)| *process == name) {
                metrics.insert((*metric).into(), record(ns));
            }
            let telemetry = json!({
                "metrics": metrics, "ring_dropped": 0, "allocations": { "loop": 1, "transport": 30 },
                "major_faults": 2, "loop_minor_faults": 3, "cpu_s": 0.5, "ready_after_ms": ns as f64,
                "realtime": ["scheduling: SCHED_FIFO priority 70"],
            });
            (name, json!({ "telemetry": telemetry, "accepted": 9 }))
        });
        let by_loop = |count: u64| json!({ "retarget": count, "control": count + 1, "driver": count + 2 });
        let run = json!({ "ticks": by_loop(100), "missed_deadlines": by_loop(5) });
        Outcome { kind: Kind::Events, processes: processes.to_vec(), run, wall_s: 2.0, published: 10 }
    }

    #[test]
    fn merged_figures_are_the_sums_of_their_blocks() {
        let all = VariantFigures::merge(&[outcome(1_000), outcome(3_000)]).expect("whole reports");
        assert_eq!((all.missed, all.ticks), ([10, 12, 14], [200, 202, 204]));
        assert_eq!((all.published, all.accepted, all.blocks, all.wall_s), (20, 18, 2, 4.0));
        for (name, hop) in all.hops().chain(all.wake_ups()) {
            assert_eq!((hop.count(), hop.max_us(), hop.seconds.len()), (20, 3.0, 2), "{name}");
        }
        assert_eq!(all.total(|process| process.allocations.r#loop), 10);
        assert_eq!(all.total(|process| process.allocations.transport), 300);
        assert_eq!(all.total(|process| process.major_faults), 20);
        let json = all.to_json();
        assert_eq!(json["processes"]["driver"]["cpu"], 0.25);
        assert_eq!(json["processes"]["ingest"]["ready_after_ms"], 3_000.0);
        assert_eq!(json["hops_us"]["target_to_command"]["count"], 20);
    }

    #[test]
    fn incomplete_report_is_refused_by_process() {
        let nothing = Map::new().into();
        for (process, pointer, with, named) in [
            ("control", "/telemetry/metrics", nothing, "control: target_to_control is missing"),
            ("retarget", "/telemetry/major_faults", Value::Null, "retarget: invalid type: null"),
            (
                "driver",
                "/telemetry/metrics/target_to_command/buckets",
                json!([]),
                "driver counted no target_to_command",
            ),
            ("ingest", "/accepted", json!("many"), "ingest: invalid type: string"),
        ] {
            let mut one = outcome(1_000);
            let (_, report) = one.processes.iter_mut().find(|(name, _)| *name == process).unwrap();
            *report.pointer_mut(pointer).unwrap() = with;
            let error = VariantFigures::merge(&[one]).expect_err(pointer).to_string();
            assert!(error.contains(named), "{error}");
        }
    }
}
