//! Runs one block of the real processes: starts, engages, measures, releases and ends them in order.

use crate::blocks::{Block, Kind};
use crate::client::Client;
use crate::error::LatencyError;
use crate::observers::Observers;
use crate::settings::{self, Changes};
use instance::Instance;
use messages::{Faults, Mode};
use operator::OperatorSession;
use rt::{Realtime, Shutdown};
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};
use teleopd::{Children, Failure, InstanceArgs, Output, PROCESSES, Report};

/// Time between two looks at the processes.
const LOOK: Duration = Duration::from_millis(50);
/// Longest time until nothing inhibits engaging. The processes are ready, so a few hundred ms are enough.
const CLEAR_WITHIN: Duration = Duration::from_secs(10);
/// Longest time from the enable to Engaged: 3 s of blending, and 5 s for the torso's whole stroke.
const ENGAGED_WITHIN: Duration = Duration::from_secs(20);
/// Longest time from release to rest: four times the longest stop.
const REST_WITHIN: Duration = Duration::from_secs(2);
/// Ticks of control before the enable, as an operator would wait.
const TICKS_BEFORE_ENABLE: u64 = 600;

/// Inputs of every block of processes.
#[derive(Clone, Debug)]
pub struct Setup {
    /// Settings file.
    pub config: PathBuf,
    /// Changes to the settings.
    pub changes: Changes,
    /// Skeletons per second.
    pub rate_hz: f64,
}

/// Results of a block.
#[derive(Clone, Debug)]
pub struct Outcome {
    /// Kind of the block.
    pub kind: Kind,
    /// The report of each process, in the order of `PROCESSES`.
    pub processes: Vec<(&'static str, Value)>,
    /// The report of the run, as `teleopd demo` writes it.
    pub run: Value,
    /// Time from READY of the last process to the end of the first, s.
    pub wall_s: f64,
    /// Skeletons that the client published.
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
    let told = lines.find_map(|line| line.strip_prefix("cores: "))?;
    if told.contains("REFUSED") {
        return None;
    }
    let (_, list) = told.split_once('[')?;
    let (list, _) = list.split_once(']')?;
    list.split(',').map(|core| core.trim().parse().ok()).collect()
}

/// The instance of one block. Its drop removes all of its shared memory.
struct Retired(Instance);

impl Drop for Retired {
    fn drop(&mut self) {
        self.0.retire();
    }
}

/// Runs one block.
///
/// # Errors
/// Returns an error if a process does not start, ends by itself or does not engage, or if a promise was broken.
pub fn run(setup: &Setup, block: Block, shutdown: &Shutdown) -> Result<Outcome, LatencyError> {
    let folder = Folder::new()?;
    let config = folder.path().join("teleop.toml");
    settings::write(&setup.config, &setup.changes, block.kind, &config)?;
    let instance = Instance::new(folder.path()).map_err(|error| LatencyError::write(folder.path(), error))?;
    // Created before the processes, so that it is dropped after them, even if one of them does not start.
    let instance = Retired(instance);
    let place = InstanceArgs {
        config,
        run_dir: folder.path().to_path_buf(),
        // The driver is simulated, and the measurement must also work on a kernel without PREEMPT_RT.
        engage_without_realtime: true,
        interface: None,
    };
    let mut children = Children::start(&instance.0, &place, Output::Files)?;
    let onlookers = (block.kind == Kind::ObserverCost).then(|| Observers::start(&instance.0, &place)).transpose()?;
    let settings = config::load(&place.config, place.overrides())?.settings.realtime;
    // Client and operator represent other programs. They stay on the cores of `ingest`, away from the measured
    // core.
    let others = teleopd::placement(&settings).others;
    let driven = std::thread::scope(|scope| {
        let drive = || {
            if let Some(cores) = &others {
                let _ = Realtime::keep_to(cores);
            }
            drive(&instance.0, &mut children, setup.rate_hz, block.seconds, shutdown)
        };
        scope.spawn(drive).join()
    });
    let driven = driven.unwrap_or_else(|_| Err(LatencyError::Invalid("the client's thread panicked".into())));
    let mut trouble = onlookers.map_or(Vec::new(), Observers::stop);
    trouble.extend(children.stop());
    let Driven { wall_s, published, failures, ended } = driven?;
    trouble.extend(ended.err());
    if shutdown.requested() {
        return Err(LatencyError::Interrupted);
    }
    if failures > 0 {
        trouble.push(format!("the bus did not accept {failures} skeletons"));
    }
    let report = match Report::collect(&instance.0) {
        Ok(report) => report,
        Err(failure) => {
            trouble.push(failure.text);
            return Err(LatencyError::Invalid(trouble.join("; ")));
        }
    };
    trouble.extend(report.complaints());
    if !trouble.is_empty() {
        return Err(LatencyError::Invalid(trouble.join("; ")));
    }
    let mut processes = Vec::new();
    for name in PROCESSES {
        processes.push((name, read(&instance.0.report(name))?));
    }
    Ok(Outcome { kind: block.kind, processes, run: report.to_json().clone(), wall_s, published })
}

/// Observations of client and operator.
struct Driven {
    wall_s: f64,
    published: u64,
    failures: u64,
    ended: Result<(), String>,
}

/// Publishes skeletons, engages, and releases after `seconds`.
fn drive(
    instance: &Instance,
    children: &mut Children,
    rate_hz: f64,
    seconds: f64,
    shutdown: &Shutdown,
) -> Result<Driven, LatencyError> {
    let started = Instant::now();
    let client = Client::start(instance.input_domain(), rate_hz)?;
    let operator = OperatorSession::connect(&instance.operator_socket()).map_err(Failure::from)?;
    let ended = engage_and_hold(children, &operator, &client, seconds, shutdown);
    operator.release();
    operator.wait(REST_WITHIN, |status| {
        !matches!(Mode::from_u32(status.mode), Some(Mode::Engaging | Mode::Engaged | Mode::Holding))
    });
    let wall_s = started.elapsed().as_secs_f64();
    let (published, failures) = client.stop();
    Ok(Driven { wall_s, published, failures, ended })
}

/// Engages, lets the person move, and watches the run for `seconds`. Returns the problem, if any.
fn engage_and_hold(
    children: &mut Children,
    operator: &OperatorSession,
    client: &Client,
    seconds: f64,
    shutdown: &Shutdown,
) -> Result<(), String> {
    if !operator
        .wait(CLEAR_WITHIN, |status| status.faults == 0 && status.moving == 0 && status.ticks > TICKS_BEFORE_ENABLE)
    {
        let faults = operator.status().map_or(Faults::NONE, |status| Faults(status.faults));
        let names: Vec<_> = faults.iter().map(|fault| fault.row().meaning).collect();
        return Err(format!("cannot engage: {}", names.join(" ")));
    }
    operator.enable();
    let enabled = Instant::now();
    let mut engaged: Option<Instant> = None;
    while engaged.is_none_or(|since| since.elapsed().as_secs_f64() < seconds) && !shutdown.requested() {
        std::thread::sleep(LOOK);
        if let Some((name, status)) = children.ended() {
            return Err(format!("{name} ended by itself ({status})"));
        }
        match (operator.mode(), engaged) {
            (Some(Mode::Engaged), None) => {
                engaged = Some(Instant::now());
                client.move_on();
            }
            (Some(Mode::Faulted), _) => return Err("the robot was stopped".into()),
            (Some(Mode::Disengaged), Some(_)) => return Err("the robot was released before the end".into()),
            (None, _) => return Err("control does not answer".into()),
            (_, None) if enabled.elapsed() > ENGAGED_WITHIN => return Err("the robot did not engage".into()),
            _ => {}
        }
    }
    Ok(())
}

fn read(path: &Path) -> Result<Value, LatencyError> {
    let text =
        std::fs::read_to_string(path).map_err(|error| LatencyError::Invalid(format!("{}: {error}", path.display())))?;
    serde_json::from_str(&text).map_err(|error| LatencyError::Invalid(format!("{}: {error}", path.display())))
}

/// The block's folder. It is removed when the block ends.
struct Folder(tempfile::TempDir);

impl Folder {
    // The prefix is short because the path of the operator's socket is limited to 107 bytes.
    fn new() -> Result<Self, LatencyError> {
        let made = tempfile::Builder::new().prefix("latency-").tempdir();
        made.map(Self).map_err(|error| LatencyError::write(&std::env::temp_dir(), error))
    }

    fn path(&self) -> &Path {
        self.0.path()
    }
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
