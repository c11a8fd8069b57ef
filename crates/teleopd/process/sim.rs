//! The simulated robot, behind the driver's port: executes a command when it arrives, or its plan when none does.

use super::{Process, WARM_TICKS, bus_failure};
use crate::cli::Place;
use crate::exit::{Exit, Failure};
use crate::timeline::Timeline;
use bus::Domain;
use messages::{Header, JointCommand, RobotState, Service, Stamp, TICK_HZ, deadline, tick_at};
use serde_json::{Map, Value, json};
use std::time::Duration;

/// A driver that is told to end plays its plan to rest; the longest stop is 0.5 s, and this is twice that.
const END_WITHIN_NS: u64 = 1_000_000_000;

/// Runs until shutdown, and then until the robot is at rest.
pub fn run(place: &Place) -> Result<(), Failure> {
    let process = Process::start("sim", place, |loaded| Some(loaded.settings.realtime.priority_driver))?;
    let config = pipeline::sim_config(&process.loaded, process.realtime.is_realtime())
        .map_err(|error| Failure::new(Exit::Config, error))?;
    let seed = process.loaded.settings.sim.seed;
    let core = Domain::open(process.instance.core_domain(), "sim").map_err(bus_failure)?;
    let mut commands = core.waking_reader::<JointCommand>(Service::JointCommand).map_err(bus_failure)?;
    let mut states = core.writer::<RobotState>(Service::RobotState).map_err(bus_failure)?;

    let mut warm = sim::State::new(&config, 0, seed);
    for k in 1..=WARM_TICKS {
        std::hint::black_box(sim::tick(&config, &mut warm, deadline(k), sim::Input { due_k: k, command: None }));
    }
    let grace_ns = (process.loaded.settings.driver.grace_us * 1e3) as u64;
    let due = |now: Stamp| tick_at(Stamp(now.0.saturating_sub(grace_ns)));
    let mut figures = Figures::new();
    let (mut sequence, mut publish_failures) = (0, 0_u64);
    // A driver that starts holds where it stands; three indices of distance keep identities apart after a quick restart.
    let mut state = sim::State::new(&config, due(rt::now()) + 3, seed);
    process.ready()?;
    let mut ending: Option<Stamp> = None;
    loop {
        let now = rt::now();
        if process.shutdown.requested() {
            // A driver that is told to end takes no command any more: it plays its plan, and ends at rest.
            let since = *ending.get_or_insert(now);
            if state.at_rest() || now.since(since) > END_WITHIN_NS {
                break;
            }
        }
        let give_up = deadline(state.follower().index() + 1).plus_ns(grace_ns);
        if now < give_up {
            commands.wait(Duration::from_nanos(give_up.since(now)));
        }
        let command = commands.latest().filter(|_| ending.is_none());
        let now = rt::now();
        let out = sim::tick(&config, &mut state, now, sim::Input { due_k: due(now), command: command.as_ref() });
        if out.advanced == 0 {
            continue;
        }
        let mut message = out.state;
        sequence += 1;
        message.header = Header {
            sequence,
            stamp: rt::now(),
            origin: message.header.origin,
            config_hash: process.loaded.hash,
            incarnation: process.incarnation,
            reserved: 0,
        };
        publish_failures += u64::from(states.publish(&message).is_err());
        figures.note(now, &out);
        process.alive();
    }
    let mut report = figures.to_json(state.report());
    report["commands_accepted"] = json!(state.follower().accepted);
    report["ended_at_rest"] = json!(state.at_rest());
    report["interface"] = json!(process.loaded.settings.sim.interface.name());
    if let Some(delays_s) = state.delays_s() {
        report["controller_delays_ms"] = json!(delays_s.map(|delay_s| delay_s * 1e3));
    }
    report["publish_failures"] = json!(publish_failures);
    report["realtime"] = json!(process.realtime.is_realtime());
    process.leave(&report)
}

/// What the driver measures of the stream it executes.
struct Figures {
    timeline: Timeline,
    skeleton_to_command: rt::Histogram,
    target_to_command: rt::Histogram,
    lateness: rt::Histogram,
}

impl Figures {
    fn new() -> Self {
        Self {
            timeline: Timeline::new(),
            skeleton_to_command: rt::Histogram::new(),
            target_to_command: rt::Histogram::new(),
            lateness: rt::Histogram::new(),
        }
    }

    fn note(&mut self, now: Stamp, out: &sim::Output) {
        // A tick ran for its index if a command was executed for it; a plan tick is a deadline that control missed.
        if let Some(accepted) = out.accepted {
            self.timeline.note(accepted.k);
            self.lateness.record_between(deadline(accepted.k), now);
            if let Some(age_ns) = accepted.origin_age_ns {
                self.skeleton_to_command.record_ns(age_ns);
            }
            if let Some(age_ns) = accepted.target_age_ns {
                self.target_to_command.record_ns(age_ns);
            }
        }
    }

    fn to_json(&self, report: &sim::Report) -> Value {
        let violations: Map<_, _> =
            report.violations().iter().map(|&(kind, count)| (kind.to_owned(), json!(count))).collect();
        json!({
            "timeline": self.timeline.to_json(),
            "latency_us": {
                "skeleton_to_command": self.skeleton_to_command.to_json(),
                "target_to_command": self.target_to_command.to_json(),
            },
            "executed_after_deadline_us": self.lateness.to_json(),
            "violations": violations,
            "min_clearance_mm": report.min_clearance_m() * 1e3,
            "engage": {
                "max_step_rad": report.engage_max_step_rad(),
                "first_second_velocity_ratio": report.engage_first_second_velocity_ratio(),
            },
            "rate_hz": TICK_HZ,
        })
    }
}
