//! Runs one block of the real processes: starts, engages, measures, releases and ends them in order.

use crate::blocks::{Block, Kind};
use crate::client::Client;
use crate::settings::Changes;
use harness::{Harness, Look, Operator};
use messages::Mode;
use rt::{Exit, Failure, Realtime, Shutdown};
use serde_json::Value;
use std::path::PathBuf;
use std::time::{Duration, Instant};
use teleopd::{PROCESSES, Report, Simulator};

/// Longest time from release to rest: four times the longest stop.
const REST_WITHIN: Duration = Duration::from_secs(2);
#[derive(Clone, Debug)]
pub struct Setup {
    pub config: PathBuf,
    pub changes: Changes,
    pub rate_hz: f64,
}

#[derive(Clone, Debug)]
pub struct Outcome {
    pub kind: Kind,
    /// The report of each process, in the order of `PROCESSES`.
    pub processes: Vec<(&'static str, Value)>,
    /// The report of the run, as `teleopd demo` writes it.
    pub run: Value,
    /// Time from READY of the last process to the end of the first, s.
    pub wall_s: f64,
    pub published: u64,
}

impl Outcome {
    /// Returns the cores on which retarget ran. None if the kernel chose them.
    pub fn cores(&self) -> Option<Vec<usize>> {
        let (_, report) = self.processes.iter().find(|(name, _)| *name == "retarget")?;
        let lines = report["telemetry"]["realtime"].as_array()?.iter().filter_map(Value::as_str);
        cores_of(lines)
    }
}

/// Parses the lines in which a process reports the granted properties: `cores: cores [1, 2]`.
fn cores_of<'a>(mut lines: impl Iterator<Item = &'a str>) -> Option<Vec<usize>> {
    let cores_line = lines.find_map(|line| line.strip_prefix("cores: "))?;
    if cores_line.contains("REFUSED") {
        return None;
    }
    let (_, list) = cores_line.split_once('[')?;
    let (list, _) = list.split_once(']')?;
    list.split(',').map(|core| core.trim().parse().ok()).collect()
}

pub fn run(setup: &Setup, block: Block, shutdown: &Shutdown) -> Result<Outcome, Failure> {
    let mut harness = Harness::start(&setup.config, Some(&setup.changes.toml(block.kind)))?;
    let place = harness.place.clone();
    let loaded = place.load()?;
    // Client and operator represent other programs. They stay on the cores of `ingest`, away from the measured core.
    let others = teleopd::placement(&loaded.settings.realtime).others;
    let driven = std::thread::scope(|scope| {
        let drive = || {
            if let Some(cores) = &others {
                let _ = Realtime::keep_to(cores);
            }
            drive(&mut harness, setup.rate_hz, block.seconds, shutdown)
        };
        scope.spawn(drive).join()
    });
    let invalid = Failure::with(Exit::Failed);
    let driven = driven.unwrap_or_else(|_| Err(invalid("the client's thread panicked".to_owned())));
    let mut trouble = harness.children.stop();
    let Driven { wall_s, published, failures, ended } = driven?;
    if shutdown.requested() {
        return Err(::report::interrupted());
    }
    trouble.extend(ended.err().map(|failure| failure.text));
    if failures > 0 {
        trouble.push(format!("the bus did not accept {failures} skeletons"));
    }
    let report = Report::collect(&harness.instance, Simulator::BuiltIn, None);
    match &report {
        Ok(report) => trouble.extend(report.complaints()),
        Err(failure) => trouble.push(failure.text.clone()),
    }
    let (Ok(report), true) = (report, trouble.is_empty()) else { return Err(invalid(trouble.join("; "))) };
    let read = |name| Some((name, harness.report(name)?));
    let processes = PROCESSES.into_iter().filter_map(read).collect();
    Ok(Outcome { kind: block.kind, processes, run: report.to_json().clone(), wall_s, published })
}

/// Observations of client and operator.
struct Driven {
    wall_s: f64,
    published: u64,
    failures: u64,
    ended: Result<(), Failure>,
}

fn drive(harness: &mut Harness, rate_hz: f64, seconds: f64, shutdown: &Shutdown) -> Result<Driven, Failure> {
    let started = Instant::now();
    let client = Client::start(harness.instance.input_domain(), rate_hz);
    let client = client.map_err(Failure::with(Exit::Unavailable))?;
    let mut operator = harness.operator()?;
    let mut look = || if shutdown.requested() { Err(::report::interrupted()) } else { harness.watch() };
    let ended = engage_and_hold(&mut operator, &client, seconds, &mut look);
    operator.release();
    operator.wait(REST_WITHIN, |status| {
        !matches!(Mode::from_u32(status.mode), Some(Mode::Engaging | Mode::Engaged | Mode::Holding))
    });
    let wall_s = started.elapsed().as_secs_f64();
    let (published, failures) = client.stop();
    Ok(Driven { wall_s, published, failures, ended })
}

/// Engages, lets the person move, and watches the run for `seconds`.
fn engage_and_hold(operator: &mut Operator, client: &Client, seconds: f64, look: Look) -> Result<(), Failure> {
    operator.clear(look)?;
    operator.enable();
    operator.reach(Mode::Engaged, look)?;
    client.move_on();
    operator.hold(Duration::from_secs_f64(seconds), look)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cores_of_a_process_are_those_granted() {
        let of = |line| cores_of(["scheduling: SCHED_FIFO priority 70", line].into_iter());
        assert_eq!(of("cores: cores [1]"), Some(vec![1]));
        assert_eq!(of("cores: cores [2, 3]"), Some(vec![2, 3]));
        assert_eq!(of("cores: not requested"), None);
        assert_eq!(of("cores: REFUSED: cores [9]: Invalid argument"), None);
    }
}
