//! Turns skeletons into joint targets on the fixed deadlines of the tick grid.

use super::{Process, WARM_TICKS, bus_failure};
use crate::cli::Place;
use crate::exit::{Exit, Failure};
use crate::timeline::Timeline;
use bus::Domain;
use messages::{Header, JointTarget, Service, Skeleton, deadline};
use rt::PeriodicLoop;
use serde_json::json;

/// Runs until shutdown.
pub fn run(place: &Place) -> Result<(), Failure> {
    let process = Process::start("retarget", place, |loaded| Some(loaded.settings.realtime.priority_retarget))?;
    let config = pipeline::retarget_config(&process.loaded).map_err(|error| Failure::new(Exit::Config, error))?;
    let core = Domain::open(process.instance.core_domain(), "retarget").map_err(bus_failure)?;
    let mut skeletons = core.reader::<Skeleton>(Service::Skeleton).map_err(bus_failure)?;
    let mut targets = core.writer::<JointTarget>(Service::JointTarget).map_err(bus_failure)?;

    let mut state = retarget::State::default();
    let mut warm = state.clone();
    for k in 0..WARM_TICKS {
        std::hint::black_box(retarget::tick(&config, &mut warm, deadline(k), retarget::Input { k, skeleton: None }));
    }
    let (mut timeline, mut work) = (Timeline::new(), rt::Histogram::new());
    let (mut sequence, mut publish_failures) = (0, 0_u64);
    process.ready()?;
    let mut periodic = PeriodicLoop::start().spinning_us(process.loaded.settings.realtime.spin_us);
    while let Some(tick) = periodic.next(&process.shutdown) {
        let skeleton = skeletons.latest();
        let mut target =
            retarget::tick(&config, &mut state, tick.woke, retarget::Input { k: tick.k, skeleton: skeleton.as_ref() })
                .target;
        sequence += 1;
        let stamp = rt::now();
        target.header = Header {
            sequence,
            stamp,
            origin: target.header.origin,
            config_hash: process.loaded.hash,
            incarnation: process.incarnation,
            reserved: 0,
        };
        publish_failures += u64::from(targets.publish(&target).is_err());
        publish_failures += u64::from(targets.notify().is_err());
        timeline.note(tick.k);
        work.record_between(tick.woke, stamp);
        process.alive();
    }
    process.leave(&json!({
        "timeline": timeline.to_json(),
        "wake_up_us": periodic.lateness().to_json(),
        "work_us": work.to_json(),
        "publish_failures": publish_failures,
        "realtime": process.realtime.is_realtime(),
    }))
}
