//! Turns skeletons into joint targets at the fixed deadlines of the tick grid.

use super::{Process, WARM_TICKS, bus_failure};
use crate::cli::InstanceArgs;
use crate::timeline::Timeline;
use bus::Domain;
use messages::{JointTarget, PolicyChunk, Service, Skeleton, deadline};
use rt::{Exit, Failure, PeriodicLoop};
use serde_json::json;
use telemetry::Metric;

pub fn run(place: &InstanceArgs) -> Result<(), Failure> {
    let mut process = Process::start("retarget", place, |loaded| Some(loaded.settings.realtime.priority_retarget))?;
    let config = world::retarget_config(&process.loaded).map_err(Failure::with(Exit::Config))?;
    let core = Domain::open(process.instance.core_domain(), "retarget").map_err(bus_failure)?;
    let mut skeletons = core.reader::<Skeleton>(Service::Skeleton).map_err(bus_failure)?;
    let mut targets = core.writer::<JointTarget>(Service::JointTarget).map_err(bus_failure)?;
    let mut chunks = core.reader::<PolicyChunk>(Service::Policy).map_err(bus_failure)?;
    let mut led = core.writer::<JointTarget>(Service::PolicyTarget).map_err(bus_failure)?;
    let policy_config = world::policy_config(&process.loaded);
    let (mut policy, mut leads) = (Box::<retarget::policy::State>::default(), false);

    let mut state = retarget::State::default();
    let mut warm = state.clone();
    for k in 0..WARM_TICKS {
        std::hint::black_box(retarget::tick(&config, &mut warm, deadline(k), retarget::Input { k, skeleton: None }));
    }
    let (mut timeline, mut sequence) = (Timeline::new(), 0);
    process.ready()?;
    let mut periodic = PeriodicLoop::start().spinning_us(process.loaded.settings.realtime.spin_us);
    while let Some(tick) = periodic.next(&process.shutdown) {
        process.probe.record_ns(Metric::WakeUp, tick.woke, tick.late_ns);
        process.missed(tick.missed);
        let skeleton = rt::allocating_aside(|| skeletons.latest());
        if let Some(skeleton) = &skeleton {
            process.probe.record(Metric::IngestToRetarget, skeleton.header.stamp, tick.woke);
        }
        let chunk = rt::allocating_aside(|| chunks.latest());
        if leads || chunk.is_some() {
            let mut target = retarget::policy::tick(&policy_config, &mut policy, tick.woke, tick.k, chunk.as_ref());
            let stamp = rt::now();
            let is_old = process.is_old(tick.k, stamp);
            // The last one says that the policy is gone. It must go out.
            leads = target.session_nonce != 0 || is_old;
            target.header = process.header(sequence + 1, stamp, target.header.origin);
            if !is_old {
                process.publish(&mut led, &target);
            }
        }
        let mut target =
            retarget::tick(&config, &mut state, tick.woke, retarget::Input { k: tick.k, skeleton: skeleton.as_ref() })
                .target;
        sequence += 1;
        let stamp = rt::now();
        target.header = process.header(sequence, stamp, target.header.origin);
        if !process.is_old(tick.k, stamp) {
            process.publish_and_wake(&mut targets, &target);
        }
        timeline.add(tick.k);
        process.probe.record(Metric::RetargetWork, tick.woke, stamp);
        process.alive();
    }
    process.leave(json!({ "timeline": timeline }))
}
