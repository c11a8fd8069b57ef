//! The processes. Each runs the same few steps. It reads the configuration, asks for real-time rights, opens the
//! bus, warms up and reports READY. Then it waits, reads the latest message, ticks and publishes. At the end it
//! writes its figures.

pub mod control;
pub mod driver;
pub mod ingest;
pub mod realtime;
pub mod remote;
pub mod retarget;
pub mod robot;
pub mod targets;

mod feedback;
mod housekeeping;
mod lease;

use crate::children::instance_in;
use crate::cli::InstanceArgs;
use crate::processes::metrics_port;
use bus::Writer;
use config::{DriverKind, Loaded, Settings};
use housekeeping::Housekeeping;
use instance::Instance;
use messages::{Header, Message, Stamp};
use rt::{Exit, Failure};
use rt::{PageFaults, Realtime, RealtimeReport, ServiceManager, Shutdown};
use serde_json::json;
use telemetry::{Collector, Counter, Event, Probe};

/// Ticks on a copy of the state before READY. Caches, branch predictors and lazily mapped pages are warm after
/// far fewer. After about 200, a starting process shows no tick slower than its median.
pub const WARM_TICKS: u64 = 1000;

/// Fewest open files that one process needs. A writer, a reader and their events need 27 (measured, iceoryx2
/// 0.10.0). The sum has four such pairs, and the files that each of 16 readers and 16 clients adds.
pub const NOFILE_LEAST: u64 = 256;

/// Age at which a message is no longer sent. Two ticks after its deadline the driver has already played its plan
/// for it.
const OLD_NS: u64 = 2 * 1_000_000_000 / messages::TICK_HZ;

/// State that every process sets up before it opens the bus, and that every loop uses beside its tick.
pub struct Process {
    pub name: &'static str,
    pub loaded: Loaded,
    pub instance: Instance,
    pub shutdown: Shutdown,
    pub incarnation: u32,
    pub realtime: RealtimeReport,
    /// Cores of the threads beside the loop. None if any will do.
    pub others: Option<Vec<usize>>,
    pub probe: Probe,
    housekeeping: Housekeeping,
    manager: ServiceManager,
    started: Stamp,
    at_ready: AtReady,
}

/// Resource use of the process when it reported READY.
#[derive(Clone, Copy, Default)]
struct AtReady {
    after_ms: f64,
    faults: PageFaults,
    of_loop: PageFaults,
    cpu_ns: u64,
}

impl Process {
    /// Reads the configuration and asks for real-time rights. `priority` is that of SCHED_FIFO, `None` for an
    /// expendable process.
    pub fn start(
        name: &'static str,
        place: &InstanceArgs,
        priority: impl Fn(&Loaded) -> Option<u32>,
    ) -> Result<Self, Failure> {
        let started = rt::now();
        rt::die_with_parent();
        keep_private();
        telemetry::install_logging(telemetry::LevelFilter::INFO);
        if let Some(limit) = rt::Limits::of_process().nofile.filter(|&limit| limit < NOFILE_LEAST) {
            let text = format!("{limit} open files are allowed, {NOFILE_LEAST} are needed (ulimit -n, LimitNOFILE=)");
            return Err(Failure::new(Exit::Unavailable, text));
        }
        let loaded = place.load()?;
        let instance = instance_in(&place.run_dir)?;
        let shutdown = Shutdown::on_signals().map_err(Failure::with(Exit::Software))?;
        let manager = ServiceManager::from_environment().map_err(Failure::with(Exit::Unavailable))?;
        let (probe, collector) = telemetry::channel(name);
        let relaxed = may_lack_realtime(&loaded.settings);
        let collector = collector.relaxed(relaxed);
        let (config, others) = realtime::request(&loaded.settings.realtime, priority(&loaded));
        let port = metrics_port(loaded.settings.metrics.port, name);
        let housekeeping = Housekeeping::start(collector, port, others.clone())?;
        let realtime = Realtime::apply(&config);
        tracing::info!("{name}: {}", realtime.granted().join("; "));
        for refusal in realtime.refusals() {
            if relaxed {
                tracing::info!("{name}: {refusal} (a simulated robot does not need it)");
            } else {
                tracing::warn!("{name}: {refusal}");
            }
        }
        Ok(Self {
            name,
            loaded,
            instance,
            shutdown,
            incarnation: rt::incarnation(),
            realtime,
            others,
            probe,
            housekeeping,
            manager,
            started,
            at_ready: AtReady::default(),
        })
    }

    /// Reports to the service manager that the process is ready. From now on the loop's allocations are counted.
    /// The watchdog is fed while the loop runs.
    pub fn ready(&mut self) -> Result<(), Failure> {
        self.manager
            .ready()
            .map_err(|error| Failure::new(Exit::Software, format!("NOTIFY_SOCKET: READY was not accepted: {error}")))?;
        self.housekeeping.ready();
        self.at_ready = AtReady {
            after_ms: rt::now().since(self.started) as f64 * 1e-6,
            faults: PageFaults::of_process(),
            of_loop: PageFaults::of_thread(),
            cpu_ns: rt::cpu_time_ns(),
        };
        rt::watch_allocations();
        Ok(())
    }

    pub fn alive(&mut self) {
        let counters = self.probe.counters();
        counters.add(Counter::Ticks, 1);
        let (own, transport) = rt::allocations();
        counters.set(Counter::Allocations, own.allocated);
        counters.set(Counter::TransportAllocations, transport.allocated);
    }

    pub fn header(&self, sequence: u64, stamp: Stamp, origin: Stamp) -> Header {
        let (config_hash, incarnation) = (self.loaded.hash, self.incarnation);
        Header { sequence, stamp, origin, config_hash, incarnation, reserved: 0 }
    }

    /// Publishes `message`. A failure is counted and logged, and this message is lost.
    pub fn publish<M: Message>(&mut self, writer: &mut Writer<M>, message: &M) {
        let published = rt::allocating_aside(|| writer.publish(message));
        self.count_publish_failure(published.is_err());
    }

    pub fn publish_and_wake<M: Message>(&mut self, writer: &mut Writer<M>, message: &M) {
        self.publish(writer, message);
        let woken = rt::allocating_aside(|| writer.notify());
        self.count_publish_failure(woken.is_err());
    }

    fn count_publish_failure(&mut self, failed: bool) {
        if failed {
            self.probe.counters().add(Counter::PublishFailures, 1);
            self.probe.event(Event::PublishFailed);
        }
    }

    /// Returns true if the output of tick `k` is too old to send at `now`. Then the process was suspended, or
    /// kept off its core, between its clock reading and its message. The event is counted and logged.
    pub fn is_old(&mut self, k: u64, now: Stamp) -> bool {
        let ns = now.since(messages::deadline(k));
        if ns <= OLD_NS {
            return false;
        }
        self.stood_still(k, ns);
        true
    }

    pub fn stood_still(&mut self, k: u64, ns: u64) {
        self.probe.counters().add(Counter::Gaps, 1);
        self.probe.event(Event::Gap { k, ns });
    }

    pub fn missed(&mut self, count: u64) {
        if count > 0 {
            self.probe.missed(count);
        }
    }

    /// Returns true if the kernel granted real-time scheduling, or if the settings let a simulated robot run
    /// without it.
    pub fn realtime_ok(&self) -> bool {
        self.realtime.is_realtime() || may_lack_realtime(&self.loaded.settings)
    }

    /// Writes `figures` and the loop's measurements to the instance's folder, for the report.
    pub fn leave(self, mut figures: serde_json::Value) -> Result<(), Failure> {
        let _ = self.manager.stopping();
        let faults = PageFaults::of_process().since(self.at_ready.faults);
        let of_loop = PageFaults::of_thread().since(self.at_ready.of_loop);
        let cpu_ns = rt::cpu_time_ns().saturating_sub(self.at_ready.cpu_ns);
        figures["publish_failures"] = json!(self.probe.counters().get(Counter::PublishFailures));
        figures["gaps"] = json!(self.probe.counters().get(Counter::Gaps));
        figures["realtime"] = json!(self.realtime.is_realtime());
        let mut telemetry = self.housekeeping.stop().map_or(json!({}), Collector::into_json);
        telemetry["major_faults"] = json!(faults.major);
        telemetry["loop_minor_faults"] = json!(of_loop.minor);
        telemetry["cpu_s"] = json!(cpu_ns as f64 * 1e-9);
        telemetry["ready_after_ms"] = json!(self.at_ready.after_ms);
        telemetry["realtime"] = json!(self.realtime.lines());
        figures["telemetry"] = telemetry;
        let path = self.instance.report(self.name);
        instance::write_anew(&path, figures.to_string().as_bytes())
            .map_err(|error| Failure::new(Exit::Software, format!("{}: {error}", path.display())))
    }
}

/// Returns true if the settings let a robot engage without real-time scheduling. Only a simulated robot may.
pub fn may_lack_realtime(settings: &Settings) -> bool {
    settings.control.engage_without_realtime && settings.driver.kind == DriverKind::Sim
}

/// Makes this process's files accessible to its user and group only. Disables core files, because its memory
/// holds the person's movements.
fn keep_private() {
    rustix::process::umask(rustix::fs::Mode::from_raw_mode(0o027));
    let none = rustix::process::Rlimit { current: Some(0), maximum: Some(0) };
    // Lowering a limit is always allowed.
    let _ = rustix::process::setrlimit(rustix::process::Resource::Core, none);
}

/// Returns the failure for a bus error: another instance uses the folder, or the folder is unusable.
pub fn bus_failure(error: bus::BusError) -> Failure {
    let exit = if error.is_occupied() { Exit::TempFail } else { Exit::Unavailable };
    Failure::new(exit, error)
}

/// Looks up the group of a socket by its name. An empty name means the process's own group. Returns an error for
/// an unknown group.
pub fn door_group(place: &InstanceArgs, key: &'static str, name: &str) -> Result<Option<u32>, Failure> {
    if name.is_empty() {
        return Ok(None);
    }
    match doors::group_id(name) {
        Some(gid) => Ok(Some(gid)),
        None => {
            let text = format!(
                "{}: {key} = {name:?}: this machine has no such group. Create it (groupadd --system {name}), or leave \
                 it empty for the daemon's own",
                place.config.display()
            );
            Err(Failure::new(Exit::Config, text))
        }
    }
}
