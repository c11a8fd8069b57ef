//! Publish to wake-up between two processes at 1.5 kHz: `cargo run --release -p bus --example latency [seconds]`.
//!
//! Each line is one arrangement: event-driven (the reader sleeps until it is woken) on one core, on two, and left to
//! the scheduler, plus what the single calls cost. Arrangements take turns within one run, so that they share the
//! machine's load; figures of separate runs must not be compared.

use bus::{Domain, DomainConfig, Wake};
use messages::{JointTarget, Layout, Service};
use rt::{Histogram, PeriodicLoop, Policy, Realtime, RealtimeConfig, Shutdown, now};
use std::process::Command;
use std::time::Duration;

const ROUNDS: u32 = 4;
const ARRANGEMENTS: [(&str, Option<usize>, Option<usize>); 3] =
    [("one core", Some(0), Some(0)), ("two cores", Some(0), Some(1)), ("unpinned", None, None)];

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    if let [role, root, prefix, core, ticks] = arguments.as_slice()
        && role == "writer"
    {
        return write(DomainConfig { root: root.into(), prefix: prefix.clone() }, core.parse().ok(), ticks.parse()?);
    }
    let seconds: u32 = arguments.first().map_or(Ok(3), |text| text.parse())?;
    let folder = tempfile::tempdir()?;
    let config = DomainConfig { root: folder.path().join("root"), prefix: format!("latency{}_", std::process::id()) };
    let mut wakes: [Histogram; 3] = Default::default();
    for round in 0..ROUNDS {
        for (histogram, (name, writer_core, reader_core)) in wakes.iter_mut().zip(ARRANGEMENTS) {
            let arrangement = Arrangement { writer_core, reader_core, ticks: u64::from(seconds) * 1500 };
            let (config, histogram) = (config.clone(), &mut *histogram);
            // A thread of its own, because affinity and policy stay with the thread.
            let report = std::thread::scope(|scope| {
                scope.spawn(move || arrangement.read(config, histogram)).join().expect("the reader does not panic")
            })?;
            if round == 0 {
                println!("{name}: {}", report.replace('\n', "; "));
            }
        }
    }
    for (histogram, (name, ..)) in wakes.iter().zip(ARRANGEMENTS) {
        println!("publish to wake-up, {name}: {histogram}");
    }
    single_calls(config)
}

struct Arrangement {
    writer_core: Option<usize>,
    reader_core: Option<usize>,
    ticks: u64,
}

impl Arrangement {
    fn read(&self, config: DomainConfig, wakes: &mut Histogram) -> Result<String, String> {
        let report = Realtime::apply(&realtime(self.reader_core));
        let domain = Domain::open(config.clone(), "reader").map_err(|error| error.to_string())?;
        let reader = domain.waking_reader::<JointTarget>(Service::JointTarget);
        let mut reader = reader.map_err(|error| error.to_string())?;
        let core = self.writer_core.map_or(String::from("any"), |core| core.to_string());
        let mut command = Command::new(std::env::current_exe().map_err(|error| error.to_string())?);
        command.arg("writer").arg(config.root).args([config.prefix, core, self.ticks.to_string()]);
        let mut writer = command.spawn().map_err(|error| error.to_string())?;
        while writer.try_wait().map_err(|error| error.to_string())?.is_none() {
            let wake = reader.wait(Duration::from_millis(100));
            let woke = now();
            if let (Wake::Event, Some(message)) = (wake, reader.latest()) {
                wakes.record_between(message.header.stamp, woke);
            }
        }
        Ok(report.to_string())
    }
}

fn write(config: DomainConfig, core: Option<usize>, ticks: u64) -> Result<(), Box<dyn std::error::Error>> {
    Realtime::apply(&realtime(core));
    let domain = Domain::open(config, "writer")?;
    let mut writer = domain.writer::<JointTarget>(Service::JointTarget)?;
    let (shutdown, mut periodic) = (Shutdown::new(), PeriodicLoop::start());
    let mut message = JointTarget::ZERO;
    while periodic.grid().elapsed() < ticks {
        let Some(tick) = periodic.next(&shutdown) else { break };
        message.k = tick.k;
        message.header.stamp = now();
        writer.publish(&message)?;
        writer.notify()?;
    }
    Ok(())
}

fn realtime(core: Option<usize>) -> RealtimeConfig {
    RealtimeConfig { policy: Policy::Fifo { priority: 40 }, cores: core.map(|core| vec![core]), lock_memory: false }
}

fn single_calls(config: DomainConfig) -> Result<(), Box<dyn std::error::Error>> {
    let domain = Domain::open(config, "calls")?;
    let mut writer = domain.writer::<JointTarget>(Service::JointTarget)?;
    let mut polled = domain.reader::<JointTarget>(Service::JointTarget)?;
    let mut waiting = domain.waking_reader::<JointTarget>(Service::JointTarget)?;
    let (mut publish, mut notify, mut latest, mut empty) = Default::default();
    let timed = |histogram: &mut Histogram, work: &mut dyn FnMut()| {
        let start = now();
        work();
        histogram.record_between(start, now());
    };
    for k in 0..20_000 {
        let mut message = JointTarget::ZERO;
        message.k = k;
        timed(&mut publish, &mut || {
            let _ = writer.publish(&message);
        });
        timed(&mut notify, &mut || {
            let _ = writer.notify();
        });
        timed(&mut latest, &mut || {
            let _ = polled.latest();
        });
        timed(&mut empty, &mut || {
            let _ = polled.latest();
        });
        waiting.wait(Duration::ZERO);
    }
    println!("publish: {publish}\nnotify: {notify}\nlatest, a message: {latest}\nlatest, nothing new: {empty}");
    Ok(())
}
