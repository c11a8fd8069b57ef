//! The thread beside a loop: histograms, log lines, metrics and the watchdog. It runs without real-time rights,
//! and off the loop's core if there is another core. The loop never waits for it.

use rt::{Exit, Failure, ServiceManager};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};
use telemetry::{Collector, Counter, Exposition};

/// Period at which the thread empties the ring. The ring holds two seconds.
const EVERY: Duration = Duration::from_millis(50);

/// Number of scrapers answered per round. A silent scraper costs 100 ms.
const SCRAPERS: usize = 4;

enum AuditRecord {
    /// The loop begins. From now on the thread feeds the watchdog while the loop runs.
    Ready,
    Stop,
}

pub struct Housekeeping {
    orders: Sender<AuditRecord>,
    thread: JoinHandle<Collector>,
}

impl Housekeeping {
    /// Starts the thread on `cores`. With `port` 0 it serves no metrics. Call it before the process asks for
    /// real-time rights, so that the thread has none.
    pub fn start(collector: Collector, port: u16, cores: Option<Vec<usize>>) -> Result<Self, Failure> {
        let exposition = match port {
            0 => None,
            port => Some(Exposition::bind(port).map_err(|error| {
                let exit =
                    if error.kind() == std::io::ErrorKind::AddrInUse { Exit::TempFail } else { Exit::Unavailable };
                Failure::new(
                    exit,
                    format!(
                        "metrics.port: 127.0.0.1:{port}: {error}; 0 serves none (the units have no network: \
                         examples/metrics.conf opens the loopback)"
                    ),
                )
            })?),
        };
        let manager = ServiceManager::from_environment().map_err(Failure::with(Exit::Unavailable))?;
        let (orders, received) = channel();
        let thread = std::thread::Builder::new()
            .name("housekeeping".into())
            .spawn(move || {
                if let Some(cores) = cores {
                    // If this fails, the thread runs on any core. It then costs the loop some microseconds now
                    // and then.
                    let _ = rt::Realtime::keep_to(&cores);
                }
                keep_house(collector, exposition.as_ref(), &manager, &received)
            })
            .map_err(Failure::with(Exit::Software))?;
        Ok(Self { orders, thread })
    }

    pub fn ready(&self) {
        let _ = self.orders.send(AuditRecord::Ready);
    }

    pub fn stop(self) -> Option<Collector> {
        let _ = self.orders.send(AuditRecord::Stop);
        self.thread.join().ok()
    }
}

fn keep_house(
    mut collector: Collector,
    exposition: Option<&Exposition>,
    manager: &ServiceManager,
    orders: &Receiver<AuditRecord>,
) -> Collector {
    let mut watchdog: Option<Watchdog> = None;
    loop {
        match orders.recv_timeout(EVERY) {
            Ok(AuditRecord::Ready) => watchdog = manager.watchdog_timeout().map(Watchdog::new),
            Ok(AuditRecord::Stop) | Err(RecvTimeoutError::Disconnected) => return collector,
            Err(RecvTimeoutError::Timeout) => {}
        }
        collector.drain();
        if let Some(exposition) = exposition {
            for _ in 0..SCRAPERS {
                exposition.serve(&collector);
            }
        }
        if watchdog.as_mut().is_some_and(|watchdog| watchdog.feeds(collector.counters().get(Counter::Ticks))) {
            let _ = manager.watchdog();
        }
    }
}

/// Feeds the service manager's watchdog at a quarter of its timeout, but only while the loop runs.
struct Watchdog {
    every: Duration,
    last: Instant,
    seen: u64,
}

impl Watchdog {
    fn new(patience: Duration) -> Self {
        Self { every: patience / 4, last: Instant::now(), seen: 0 }
    }

    fn feeds(&mut self, ticks: u64) -> bool {
        if self.last.elapsed() < self.every {
            return false;
        }
        self.last = Instant::now();
        let moved = ticks != self.seen;
        self.seen = ticks;
        moved
    }
}
