//! Whole-body control and the safety gate. Owns the operator socket. The target of each tick or its own deadline
//! wakes the process.

use super::{Process, WARM_TICKS, bus_failure, door_group};
use crate::cli::InstanceArgs;
use crate::figures::Following;
use crate::timeline::Timeline;
use bus::{Domain, Reader, WakingReader, Writer};
use config::{EmergencyStopReset, HandOff};
use control::STATUS_EVERY;
use messages::{
    Fault, Faults, InputStatus, JointCommand, JointTarget, Layout, Mode, PayloadRefusal, RobotState, Service, Stamp,
    Status, deadline, tick_at,
};
use operator::{AuditRecord, OperatorEdges, OperatorError, ResetRule, Server};
use robot::Names;
use rt::SleepWatch;
use rt::{Exit, Failure};
use serde_json::json;
use std::time::Duration;
use telemetry::{Counter, Event, Metric};

/// The operator socket is served on every fourth tick, 375 times a second. An emergency stop waits at most 2.7 ms.
const SERVE_EVERY: u64 = 4;
/// On SIGTERM the process ends at rest, or after this time: twice the longest stop (0.5 s) and the mode change.
const END_WITHIN_NS: u64 = 2_000_000_000;

/// Runs until shutdown, then until the robot is at rest.
pub fn run(place: &InstanceArgs) -> Result<(), Failure> {
    let process = Process::start("control", place, |loaded| Some(loaded.settings.realtime.priority_control))?;
    let config =
        world::control_config(&process.loaded, process.realtime.is_realtime()).map_err(Failure::with(Exit::Config))?;
    let names = Names::from_model(&config.model);
    instance::write_names(process.instance.run_dir(), &names).map_err(|error| {
        Failure::new(Exit::CantCreate, format!("{}: {error}", process.instance.run_dir().display()))
    })?;
    let group = door_group(place, "doors.operator_group", &process.loaded.settings.doors.operator_group)?;
    let server = Server::bind_for(process.instance.operator_socket(), group).map_err(|error| {
        let in_use = matches!(error, OperatorError::Door(doors::DoorError::InUse { .. }));
        Failure::new(if in_use { Exit::TempFail } else { Exit::Unavailable }, error)
    })?;
    // One threshold for a silent operator, used by every check.
    let server = server.with_lease_ns((process.loaded.settings.safety.operator_silent_ms * 1e6) as u64);
    let server = server.with_reset_rule(match process.loaded.settings.control.emergency_stop_reset {
        EmergencyStopReset::Anyone => ResetRule::Anyone,
        EmergencyStopReset::Presser => ResetRule::Presser,
    });
    let core = Domain::open(process.instance.core_domain(), "control").map_err(bus_failure)?;
    let mut control = Control {
        grace_ns: (process.loaded.settings.control.grace_us * 1e3) as u64,
        targets: core.waking_reader(Service::JointTarget).map_err(bus_failure)?,
        states: core.reader(Service::RobotState).map_err(bus_failure)?,
        policies: core.reader(Service::PolicyTarget).map_err(bus_failure)?,
        ingests: core.reader(Service::InputStatus).map_err(bus_failure)?,
        commands: core.writer(Service::JointCommand).map_err(bus_failure)?,
        statuses: core.writer(Service::Status).map_err(bus_failure)?,
        state: control::State::new(&config, process.incarnation),
        edges: OperatorEdges::default(),
        status: Status::ZERO,
        polled: process.loaded.settings.realtime.hand_off == HandOff::Polled,
        next_k: 0,
        target: None,
        timeline: Timeline::new(),
        sleep: SleepWatch::default(),
        following: Following::new(&config.model),
        server,
        names,
        config,
        process,
    };
    control.warm_up();
    control.process.ready()?;
    control.next_k = tick_at(rt::now()) + 1;
    control.run_to_rest();
    control.leave()
}

struct Control {
    process: Process,
    config: control::Config,
    names: Names,
    state: control::State,
    server: Server,
    edges: OperatorEdges,
    targets: WakingReader<JointTarget>,
    states: Reader<RobotState>,
    policies: Reader<JointTarget>,
    ingests: Reader<InputStatus>,
    commands: Writer<JointCommand>,
    statuses: Writer<Status>,
    grace_ns: u64,
    /// If true, no message wakes the loop. It sleeps until the deadline and grace of each index.
    polled: bool,
    /// Index after the last tick.
    next_k: u64,
    /// Target that arrived for an index already done, or that is not used yet.
    target: Option<JointTarget>,
    status: Status,
    timeline: Timeline,
    sleep: SleepWatch,
    following: Following,
}

impl Control {
    fn warm_up(&mut self) {
        let mut warm = self.state.clone();
        let mut resting = RobotState { robot: self.config.model.id(), ..RobotState::ZERO };
        resting.q = self.config.model.home;
        resting.q_measured = self.config.model.home;
        for k in 1..=WARM_TICKS {
            resting.executed_k = k - 1;
            let input = control::Input {
                k,
                target: None,
                policy: None,
                robot: Some(&resting),
                operator: OperatorEdges::default().drain(),
                ingest: None,
                realtime_ok: false,
            };
            std::hint::black_box(control::tick(&self.config, &mut warm, deadline(k), input));
        }
    }

    fn run_to_rest(&mut self) {
        let mut ending: Option<Stamp> = None;
        loop {
            let (k, woke) = self.wait();
            if self.process.shutdown.requested() {
                let since = *ending.get_or_insert(woke);
                self.edges.withdraw();
                let modes = [Mode::Engaging, Mode::Engaged, Mode::Recovering];
                let authority = modes.iter().any(|&mode| self.status.mode == mode as u32);
                // A driver that publishes no state, or no longer does, cannot show rest. Do not wait for it.
                let seen = self.status.state_stamp != Stamp::NONE && !Faults(self.status.faults).has(Fault::StateStale);
                let rests = self.status.moving == 0 || !seen;
                if (rests && !authority) || woke.since(since) > END_WITHIN_NS {
                    return;
                }
            }
            self.tick(k, woke);
            self.process.alive();
        }
    }

    /// Waits for the target of the next index, or for that index's deadline and grace. Returns the newest index
    /// due, and when it was due.
    fn wait(&mut self) -> (u64, Stamp) {
        loop {
            if let Some(target) = rt::allocating_aside(|| self.targets.latest()) {
                self.target = Some(target);
                if target.k >= self.next_k {
                    let now = rt::now();
                    // A target from the future comes from a broken clock. It must not make the index jump ahead.
                    return (target.k.min(tick_at(now)).max(self.next_k).max(self.due(now)), now);
                }
            }
            let now = rt::now();
            let give_up = deadline(self.next_k).plus_ns(self.grace_ns);
            if now >= give_up {
                return (self.next_k.max(self.due(now)), now);
            }
            if self.polled {
                rt::sleep_until(give_up);
            } else {
                rt::allocating_aside(|| self.targets.wait(Duration::from_nanos(give_up.since(now))));
            }
        }
    }

    fn due(&self, now: Stamp) -> u64 {
        tick_at(Stamp(now.0.saturating_sub(self.grace_ns)))
    }

    fn tick(&mut self, k: u64, woke: Stamp) {
        let waited_for = std::mem::replace(&mut self.next_k, k + 1);
        let robot = rt::allocating_aside(|| self.states.latest());
        // The ingest status is only copied into the status message.
        let shown = k.is_multiple_of(STATUS_EVERY);
        let ingest = if shown { rt::allocating_aside(|| self.ingests.latest()) } else { None };
        let target = self.target.take();
        let policy = rt::allocating_aside(|| self.policies.latest());
        let input = control::Input {
            k,
            target: target.as_ref(),
            policy: policy.as_ref(),
            robot: robot.as_ref(),
            operator: self.edges.drain(),
            ingest: ingest.as_ref(),
            realtime_ok: self.process.realtime_ok(),
        };
        let out = control::tick(&self.config, &mut self.state, woke, input);
        let stamp = rt::now();
        if let Some(mut command) = out.command
            && !self.process.is_old(k, stamp)
        {
            command.header.stamp = stamp;
            self.process.publish_and_wake(&mut self.commands, &command);
        }
        self.measure(waited_for, woke, stamp, target.as_ref());
        self.after(k, &out, robot.as_ref());
    }

    /// `waited_for` is the index after the last one. A wake-up that skips indices is as late as the first skipped one.
    fn measure(&mut self, waited_for: u64, woke: Stamp, done: Stamp, target: Option<&JointTarget>) {
        let probe = &mut self.process.probe;
        probe.record(Metric::WakeUp, deadline(waited_for), woke);
        probe.record(Metric::ControlWork, woke, done);
        if let Some(target) = target {
            probe.record(Metric::TargetToControl, target.header.stamp, woke);
        }
    }

    /// Does the work that can wait until the command is sent.
    fn after(&mut self, k: u64, out: &control::Output, robot: Option<&RobotState>) {
        self.process.missed(out.status.missed_deadlines - self.status.missed_deadlines);
        let Status { payload_kg: kg, payloads_taken, payloads_refused, payload_refused_why, .. } = out.status;
        if payloads_taken != self.status.payloads_taken {
            self.process.probe.event(Event::Payload { kg, refused: None });
        }
        if payloads_refused != self.status.payloads_refused {
            let refused = PayloadRefusal::from_u32(payload_refused_why).map(PayloadRefusal::meaning);
            self.process.probe.event(Event::Payload { kg, refused });
        }
        let Status { reset_first_by, resets_refused, .. } = self.status;
        self.status = Status { reset_first_by, resets_refused, ..out.status };
        self.timeline.add(k);
        self.following.add(out, robot);
        let counters = self.process.probe.counters();
        counters.set(Counter::Mode, u64::from(out.status.mode));
        counters.set(Counter::Faults, out.status.faults);
        counters.set(Counter::Latched, out.status.latched);
        if let Some(transition) = out.transition {
            self.process.probe.event(Event::Transition(transition));
        }
        if k.is_multiple_of(STATUS_EVERY) || out.transition.is_some() {
            self.process.publish(&mut self.statuses, &self.status);
        }
        if k.is_multiple_of(SERVE_EVERY) {
            let counts = self.server.poll(rt::now(), &self.status);
            self.edges.add(&counts);
            self.status.reset_first_by = counts.reset_first_by;
            self.status.resets_refused = u32::try_from(counts.resets_refused).unwrap_or(u32::MAX);
            self.look_for_sleep(k);
            let probe = &mut self.process.probe;
            probe.counters().set(Counter::Refused, counts.connections_refused + counts.requests_refused);
            self.server.drain_records(|AuditRecord { event, peer }| {
                probe.event(Event::Audit { what: event.name(), uid: peer.uid, pid: peer.pid });
            });
        }
    }

    /// After the machine slept, the person, the robot and bystanders may have moved. A robot that followed before
    /// must stop.
    fn look_for_sleep(&mut self, k: u64) {
        let slept_ns = self.sleep.slept_ns();
        if slept_ns > 0 {
            self.process.stood_still(k, slept_ns);
            self.edges.stop();
        }
    }

    fn leave(self) -> Result<(), Failure> {
        let mut figures = self.following.to_json();
        figures["timeline"] = json!(self.timeline);
        figures["status"] = explain::status_json(&self.status, &self.names);
        self.process.leave(figures)
    }
}
