//! Takes skeletons from clients, one of which holds authority, and publishes what validation leaves of them.

use super::{Process, bus_failure};
use crate::cli::Place;
use crate::exit::Failure;
use bus::{Domain, Writer};
use messages::{RawSkeleton, Service, Skeleton, TICK_HZ, deadline, tick_at};
use pipeline::{Authority, HandOff};
use serde_json::json;
use std::time::Duration;
use telemetry::{Event, Metric};

/// How long a silent door is waited at before the loop goes round: a tenth of the shortest authority timeout.
const WAIT: Duration = Duration::from_millis(10);

/// Of the frames of clients without authority, the first and every so manieth is told in the log: ten seconds at 60 Hz.
const TOLD_EVERY: u64 = 600;
/// Half a period of the tick grid, ns.
const HALF_PERIOD_NS: u64 = 500_000_000 / TICK_HZ;

/// Runs until shutdown.
pub fn run(place: &Place) -> Result<(), Failure> {
    let mut process = Process::start("ingest", place, |_| None)?;
    let input = Domain::open(process.instance.input_domain(), "ingest").map_err(bus_failure)?;
    let core = Domain::open(process.instance.core_domain(), "ingest").map_err(bus_failure)?;
    let mut clients = input.waking_reader::<RawSkeleton>(Service::RawSkeleton).map_err(bus_failure)?;
    let skeletons = core.writer::<Skeleton>(Service::Skeleton).map_err(bus_failure)?;

    let mut door = Door {
        authority: Authority::default(),
        timeout_ns: (process.loaded.settings.ingest.authority_timeout_ms * 1e6) as u64,
        config: skeleton::Config::default(),
        state: skeleton::State::new(),
        skeletons,
        sequence: 0,
    };
    let polled = process.loaded.settings.realtime.hand_off == HandOff::Polled;
    process.ready()?;
    while !process.shutdown.requested() {
        if polled {
            // Between the deadlines of `retarget`: half a period is what an unsynchronised timer costs on average.
            let k = tick_at(rt::now().plus_ns(HALF_PERIOD_NS));
            process.shutdown.sleep_until(deadline(k).plus_ns(HALF_PERIOD_NS));
        } else {
            rt::allocating_aside(|| clients.wait(WAIT));
        }
        rt::allocating_aside(|| {
            clients.drain(|sample| rt::allocating_ourselves(|| door.take(&mut process, &sample.message)))
        });
        process.alive();
    }
    let dropped: serde_json::Map<_, _> = skeleton::DropReason::ALL
        .iter()
        .filter(|&&reason| door.state.dropped(reason) > 0)
        .map(|&reason| (reason.name().to_owned(), json!(door.state.dropped(reason))))
        .collect();
    process.leave(json!({
        "accepted": door.state.accepted(),
        "dropped": dropped,
        "without_authority": door.authority.frames_refused(),
    }))
}

/// What a frame passes: authority, validation, the core domain.
struct Door {
    authority: Authority,
    timeout_ns: u64,
    config: skeleton::Config,
    state: skeleton::State,
    skeletons: Writer<Skeleton>,
    sequence: u64,
}

impl Door {
    fn take(&mut self, process: &mut Process, raw: &RawSkeleton) {
        let now = rt::now();
        process.probe.record(Metric::PublishedToIngest, raw.header.stamp, now);
        if !self.authority.admits(now, raw, self.timeout_ns) {
            let frames = self.authority.frames_refused();
            if frames % TOLD_EVERY == 1 {
                process.probe.event(Event::WithoutAuthority { frames });
            }
            return;
        }
        let Some(person) = skeleton::tick(&self.config, &mut self.state, now, skeleton::Input { raw }).skeleton else {
            return;
        };
        self.sequence += 1;
        let stamp = rt::now();
        let header = process.header(self.sequence, stamp, raw.header.origin);
        process.publish(&mut self.skeletons, &Skeleton { header, ..person });
        process.probe.record(Metric::IngestWork, now, stamp);
    }
}
