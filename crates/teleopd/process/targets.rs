//! Publishes joint targets in place of `retarget`: slow motions of one joint, for `teleopd commission`.
//!
//! Each line of the standard input is a path. It begins when it arrives. `ingest` must publish a person meanwhile: a target
//! is as fresh as that person, as with `retarget`. `control` certifies every command that follows a target.

use super::{Process, bus_failure};
use crate::cli::InstanceArgs;
use crate::commission::path::Path;
use bus::Domain;
use messages::{JointTarget, Layout, Service, Skeleton, Stamp, TICK_S, target_flag};
use rt::{Exit, Failure, PeriodicLoop};
use serde_json::json;
use std::io::BufRead;
use std::sync::mpsc::{Receiver, channel};
use telemetry::Metric;

pub fn run(place: &InstanceArgs) -> Result<(), Failure> {
    // It has the place of `retarget`: its rights, its port and its service.
    let mut process = Process::start("retarget", place, |loaded| Some(loaded.settings.realtime.priority_retarget))?;
    let core = Domain::open(process.instance.core_domain(), "retarget").map_err(bus_failure)?;
    let mut skeletons = core.reader::<Skeleton>(Service::Skeleton).map_err(bus_failure)?;
    let mut targets = core.writer::<JointTarget>(Service::JointTarget).map_err(bus_failure)?;
    let paths = read_paths()?;
    let (robot, joints) = (process.loaded.model.id(), process.loaded.model.joint_mask());
    let (mut playing, mut person, mut sequence) = (None::<(Path, u64)>, None::<Skeleton>, 0);
    process.ready()?;
    let mut periodic = PeriodicLoop::start();
    while let Some(tick) = periodic.next(&process.shutdown) {
        process.probe.record_ns(Metric::WakeUp, tick.woke, tick.late_ns);
        process.missed(tick.missed);
        rt::allocating_aside(|| {
            person = skeletons.latest().or(person);
            playing = paths.try_recv().map(|path| (path, tick.k)).ok().or(playing);
        });
        let mut target = JointTarget { k: tick.k, robot, ..JointTarget::ZERO };
        if let (Some((path, begun)), Some(person)) = (&playing, &person) {
            (target.q, target.dq) = path.at((tick.k - begun) as f64 * TICK_S);
            (target.valid_mask, target.flags) = (joints, target_flag::INPUT_FRESH);
            (target.input_received, target.input_sequence) = (person.received, person.header.sequence);
            // Another session of the client, and another `ingest`, are another person.
            target.session_nonce = person.session_nonce ^ u64::from(person.header.incarnation).rotate_left(32);
        }
        sequence += 1;
        let (stamp, origin) = (rt::now(), person.map_or(Stamp::NONE, |person| person.header.origin));
        target.header = process.header(sequence, stamp, origin);
        if !process.is_old(tick.k, stamp) {
            process.publish_and_wake(&mut targets, &target);
        }
        process.alive();
    }
    process.leave(json!({}))
}

/// Reads paths in a thread. A line that is no path is logged and ignored.
fn read_paths() -> Result<Receiver<Path>, Failure> {
    let (tell, paths) = channel();
    let read = move || {
        for line in std::io::stdin().lock().lines().map_while(Result::ok) {
            match Path::from_line(&line) {
                Some(path) => _ = tell.send(path),
                None => tracing::warn!("a line of the standard input is no path: {line}"),
            }
        }
    };
    std::thread::Builder::new().name("paths".into()).spawn(read).map_err(Failure::with(Exit::OsErr))?;
    Ok(paths)
}
