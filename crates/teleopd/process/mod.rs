//! The processes. Each is the same few steps: read the configuration, ask for real-time rights, open the bus, warm up,
//! say READY, then wait, read the latest, tick, publish; and leave its figures behind.

pub mod control;
pub mod ingest;
pub mod realtime;
pub mod retarget;
pub mod sim;

use crate::cli::Place;
use crate::exit::{Exit, Failure};
use pipeline::{Instance, Loaded};
use rt::{Realtime, RealtimeReport, ServiceManager, Shutdown};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

/// Ticks on a copy of the state before READY: caches, branch predictors and lazily mapped pages are warm after far
/// fewer (a start of the process shows no tick slower than its median after about 200).
pub const WARM_TICKS: u64 = 1000;

/// What every process has before it opens the bus.
pub struct Process {
    pub name: &'static str,
    pub loaded: Loaded,
    pub instance: Instance,
    pub shutdown: Shutdown,
    pub incarnation: u32,
    pub realtime: RealtimeReport,
    manager: ServiceManager,
    alive: Arc<AtomicU64>,
}

impl Process {
    /// Reads the configuration and asks for real-time rights: `priority` of SCHED_FIFO, nothing for an expendable process.
    pub fn start(
        name: &'static str,
        place: &Place,
        priority: impl Fn(&Loaded) -> Option<u32>,
    ) -> Result<Self, Failure> {
        rt::die_with_parent();
        let loaded =
            pipeline::load(&place.config, place.overrides()).map_err(|error| Failure::new(Exit::Config, error))?;
        let instance = Instance::new(&place.run_dir)
            .map_err(|error| Failure::new(Exit::Unavailable, format!("{}: {error}", place.run_dir.display())))?;
        let shutdown = Shutdown::on_signals().map_err(|error| Failure::new(Exit::Software, error))?;
        let manager = ServiceManager::from_environment().map_err(|error| Failure::new(Exit::Unavailable, error))?;
        let asked = &loaded.settings.realtime;
        let config = realtime::request(asked, priority(&loaded));
        let realtime = Realtime::apply(&config);
        for refusal in realtime.refusals() {
            eprintln!("{name}: warning: {refusal}");
        }
        let (incarnation, alive) = (rt::incarnation(), Arc::new(AtomicU64::new(0)));
        Ok(Self { name, loaded, instance, shutdown, incarnation, realtime, manager, alive })
    }

    /// Tells the service manager that the process is ready, and feeds its watchdog from a thread of its own, but only
    /// while `alive` moves.
    pub fn ready(&self) -> Result<(), Failure> {
        let software = |error: std::io::Error| Failure::new(Exit::Software, error);
        self.manager
            .ready()
            .map_err(|error| Failure::new(Exit::Software, format!("NOTIFY_SOCKET: READY was not taken: {error}")))?;
        if let Some(timeout) = self.manager.watchdog_timeout() {
            let manager = ServiceManager::from_environment().map_err(|error| Failure::new(Exit::Unavailable, error))?;
            let (alive, shutdown) = (Arc::clone(&self.alive), self.shutdown.clone());
            std::thread::Builder::new()
                .name("watchdog".into())
                .spawn(move || feed_watchdog(&manager, &alive, &shutdown, timeout / 2))
                .map_err(software)?;
        }
        Ok(())
    }

    /// Notes that the loop went round.
    pub fn alive(&self) {
        self.alive.fetch_add(1, Ordering::Relaxed);
    }

    /// Whether the kernel granted real-time scheduling, or the settings allow a simulated robot to do without.
    pub fn realtime_ok(&self) -> bool {
        let settings = &self.loaded.settings;
        let simulated = settings.driver.kind == pipeline::DriverKind::Sim;
        self.realtime.is_realtime() || (settings.control.engage_without_realtime && simulated)
    }

    /// Leaves `figures` in the instance's folder for whoever collects them.
    pub fn leave(&self, figures: &serde_json::Value) -> Result<(), Failure> {
        let _ = self.manager.stopping();
        let path = self.instance.report(self.name);
        std::fs::write(&path, figures.to_string())
            .map_err(|error| Failure::new(Exit::Software, format!("{}: {error}", path.display())))
    }
}

fn feed_watchdog(manager: &ServiceManager, alive: &AtomicU64, shutdown: &Shutdown, every: Duration) {
    let mut seen = alive.load(Ordering::Relaxed);
    while !shutdown.requested() {
        std::thread::sleep(every);
        let count = alive.load(Ordering::Relaxed);
        if count != seen {
            let _ = manager.watchdog();
        }
        seen = count;
    }
}

/// The bus refuses: another instance has the place, or the place cannot be used.
pub fn bus_failure(error: bus::BusError) -> Failure {
    let exit = if error.is_occupied() { Exit::TempFail } else { Exit::Unavailable };
    Failure::new(exit, error)
}
