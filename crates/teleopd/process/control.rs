//! Whole-body control and the safety gate, woken by the target of each tick or by its own deadline; owns the operator
//! socket.

use super::{Process, WARM_TICKS, bus_failure};
use crate::cli::Place;
use crate::exit::{Exit, Failure};
use crate::figures::Following;
use crate::timeline::Timeline;
use bus::{Domain, Reader, WakingReader, Writer};
use messages::{JointCommand, JointTarget, Layout, Mode, RobotState, Service, Stamp, Status, deadline, tick_at};
use operator::Server;
use pipeline::{ControlConfig, ControlInput, ControlOutput, ControlState, OperatorEdges};
use serde_json::json;
use std::time::Duration;

/// The operator socket is served on every fourth tick, 375 times a second: an emergency stop waits at most 2.7 ms.
const SERVE_EVERY: u64 = 4;
/// `Status` is published on every thirtieth tick: 50 Hz.
const STATUS_EVERY: u64 = 30;
/// On SIGTERM the process ends at rest, or after this long: twice the longest stop (0.5 s) and the mode change.
const END_WITHIN_NS: u64 = 2_000_000_000;

/// Runs until shutdown, and then until the robot is at rest.
pub fn run(place: &Place) -> Result<(), Failure> {
    let process = Process::start("control", place, |loaded| Some(loaded.settings.realtime.priority_control))?;
    let config = ControlConfig::new(&process.loaded, process.realtime.is_realtime())
        .map_err(|error| Failure::new(Exit::Config, error))?;
    pipeline::Names::of(&config.model).write(process.instance.run_dir()).map_err(|error| {
        Failure::new(Exit::CantCreate, format!("{}: {error}", process.instance.run_dir().display()))
    })?;
    let server = Server::bind(process.instance.operator_socket()).map_err(|error| {
        let exit =
            if matches!(error, operator::OperatorError::InUse { .. }) { Exit::TempFail } else { Exit::Unavailable };
        Failure::new(exit, error)
    })?;
    // One threshold for a silent operator, wherever it is noticed.
    let server = server.with_lease_ns((process.loaded.settings.safety.operator_silent_ms * 1e6) as u64);
    let core = Domain::open(process.instance.core_domain(), "control").map_err(bus_failure)?;
    let mut control = Control {
        grace_ns: (process.loaded.settings.control.grace_us * 1e3) as u64,
        targets: core.waking_reader(Service::JointTarget).map_err(bus_failure)?,
        states: core.reader(Service::RobotState).map_err(bus_failure)?,
        commands: core.writer(Service::JointCommand).map_err(bus_failure)?,
        statuses: core.writer(Service::Status).map_err(bus_failure)?,
        state: ControlState::new(&config, process.incarnation),
        edges: OperatorEdges::default(),
        status: Status::ZERO,
        next_k: 0,
        target: None,
        timeline: Timeline::new(),
        work: rt::Histogram::new(),
        lateness: rt::Histogram::new(),
        following: Following::new(),
        publish_failures: 0,
        server,
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
    config: ControlConfig,
    state: ControlState,
    server: Server,
    edges: OperatorEdges,
    targets: WakingReader<JointTarget>,
    states: Reader<RobotState>,
    commands: Writer<JointCommand>,
    statuses: Writer<Status>,
    grace_ns: u64,
    next_k: u64,
    /// Arrived for an index that was done already, or not used yet.
    target: Option<JointTarget>,
    status: Status,
    timeline: Timeline,
    work: rt::Histogram,
    lateness: rt::Histogram,
    following: Following,
    publish_failures: u64,
}

impl Control {
    fn warm_up(&mut self) {
        let mut warm = self.state.clone();
        let mut resting = RobotState::ZERO;
        resting.q = self.config.model.home;
        resting.q_measured = self.config.model.home;
        for k in 1..=WARM_TICKS {
            resting.executed_k = k - 1;
            let input = ControlInput {
                k,
                target: None,
                robot: Some(&resting),
                operator: OperatorEdges::default().take(),
                realtime_ok: false,
            };
            std::hint::black_box(pipeline::control_tick(&self.config, &mut warm, deadline(k), input));
        }
    }

    fn run_to_rest(&mut self) {
        let mut ending: Option<Stamp> = None;
        loop {
            let woke = self.wait();
            if self.process.shutdown.requested() {
                let since = *ending.get_or_insert(woke);
                self.edges.withdraw();
                let moving = self.state.commanded().v.iter().any(|v| *v != 0.0);
                let modes = [Mode::Engaging, Mode::Engaged, Mode::Recovering];
                let authority = modes.iter().any(|&mode| self.status.mode == mode as u32);
                if (!moving && !authority) || woke.since(since) > END_WITHIN_NS {
                    return;
                }
            }
            self.tick(woke);
            self.process.alive();
        }
    }

    /// Waits for the target of the next index, or for that index's deadline and grace; takes the newest index due.
    fn wait(&mut self) -> Stamp {
        loop {
            if let Some(target) = self.targets.latest() {
                self.target = Some(target);
                if target.k >= self.next_k {
                    let now = rt::now();
                    // A target from the future is a broken clock: it must not make the index jump ahead.
                    self.next_k = target.k.min(tick_at(now)).max(self.next_k).max(self.due(now));
                    return now;
                }
            }
            let now = rt::now();
            let give_up = deadline(self.next_k).plus_ns(self.grace_ns);
            if now >= give_up {
                self.next_k = self.next_k.max(self.due(now));
                return now;
            }
            self.targets.wait(Duration::from_nanos(give_up.since(now)));
        }
    }

    /// The newest index whose deadline and grace have passed.
    fn due(&self, now: Stamp) -> u64 {
        tick_at(Stamp(now.0.saturating_sub(self.grace_ns)))
    }

    fn tick(&mut self, woke: Stamp) {
        let k = self.next_k;
        self.next_k = k + 1;
        self.lateness.record_between(deadline(k), woke);
        let robot = self.states.latest();
        let target = self.target.take();
        let input = ControlInput {
            k,
            target: target.as_ref(),
            robot: robot.as_ref(),
            operator: self.edges.take(),
            realtime_ok: self.process.realtime_ok(),
        };
        let out = pipeline::control_tick(&self.config, &mut self.state, woke, input);
        if let Some(mut command) = out.command {
            command.header.stamp = rt::now();
            self.publish_failures += u64::from(self.commands.publish(&command).is_err());
            self.publish_failures += u64::from(self.commands.notify().is_err());
        }
        self.work.record_between(woke, rt::now());
        self.after(k, &out, robot.as_ref());
    }

    /// What can wait until the command is out.
    fn after(&mut self, k: u64, out: &ControlOutput, robot: Option<&RobotState>) {
        self.status = out.status;
        self.timeline.note(k);
        self.following.note(out, robot);
        if k.is_multiple_of(STATUS_EVERY) || out.transition.is_some() {
            self.publish_failures += u64::from(self.statuses.publish(&out.status).is_err());
        }
        if k.is_multiple_of(SERVE_EVERY) {
            self.edges.note(&self.server.poll(rt::now(), &self.status));
        }
    }

    fn leave(&self) -> Result<(), Failure> {
        let mut figures = self.following.to_json();
        figures["timeline"] = self.timeline.to_json();
        figures["wake_up_us"] = self.lateness.to_json();
        figures["work_us"] = self.work.to_json();
        figures["publish_failures"] = json!(self.publish_failures);
        figures["realtime"] = json!(self.process.realtime.is_realtime());
        figures["status"] = pipeline::status_json(&self.status);
        self.process.leave(&figures)
    }
}
