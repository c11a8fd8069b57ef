//! The driver of the simulated robot. Executes a command when it arrives, or its stop plan when none arrives.
//! Sends every setpoint to the process `teleopd robot`.

use super::{Process, WARM_TICKS, bus_failure};
use crate::cli::InstanceArgs;
use crate::exit::{Exit, Failure};
use crate::timeline::Timeline;
use bus::{Domain, Reader, Writer};
use driver::{Driver, Drives, Measured, Setpoint};
use messages::{
    Header, JointCommand, Mode, RobotMeasured, RobotSetpoint, RobotState, Service, Stamp, StopPlan, TICK_HZ, deadline,
    measured_flag, tick_at,
};
use pipeline::HandOff;
use serde_json::{Map, Value, json};
use std::time::Duration;
use telemetry::{Metric, Probe};

/// Time between the two measurements of a starting driver, ns. The second must confirm the speeds of the first.
const CONFIRM_NS: u64 = 6_000_000;

/// Time between two reads of the robot, ns. It measures once per cycle of its port, 1 ms.
const LOOK_NS: u64 = 1_000_000;

/// After a request to end, the driver plays its plan to rest, but no longer than this. The longest stop is 0.5 s,
/// and this is twice that.
const END_WITHIN_NS: u64 = 1_000_000_000;

/// Longest time that a driver waits for a robot, ns.
const ROBOT_WITHIN_NS: u64 = 2_000_000_000;

/// Longest time that a suspended driver waits for a current measurement, ns: 20 cycles of the robot's port.
const NEWS_WITHIN_NS: u64 = 20_000_000;

/// Connection to the robot's process, behind the driver's port.
struct RemoteRobot {
    setpoints: Writer<RobotSetpoint>,
    measurements: Reader<RobotMeasured>,
    newest: RobotMeasured,
    /// Index of the last setpoint sent.
    sent_k: u64,
    /// Header of the driver's messages. The sender fills in sequence and stamp.
    header: Header,
}

impl RemoteRobot {
    /// Waits for the robot's first measurement.
    fn find(core: &Domain, header: Header) -> Result<Self, Failure> {
        let setpoints = core.writer::<RobotSetpoint>(Service::RobotSetpoint).map_err(bus_failure)?;
        let mut measurements = core.reader::<RobotMeasured>(Service::RobotMeasured).map_err(bus_failure)?;
        let give_up = rt::now().plus_ns(ROBOT_WITHIN_NS);
        while rt::now() < give_up {
            if let Some(newest) = measurements.latest() {
                return Ok(Self { setpoints, measurements, newest, sent_k: 0, header });
            }
            rt::sleep_until(rt::now().plus_ns(LOOK_NS));
        }
        let text = format!(
            "no robot answered within {} s: start `teleopd robot` before this one (`up` and `demo` do)",
            ROBOT_WITHIN_NS / 1_000_000_000
        );
        Err(Failure::new(Exit::Unavailable, text))
    }
}

impl RemoteRobot {
    /// Waits for a robot whose last driver has just died. The robot reacts by itself. Returns once it stands
    /// still, or after a second of the robot's own time if it does not.
    fn wait_until_it_stands(&mut self) -> Result<(), Failure> {
        let first = self.read(rt::now());
        let mut standstill = driver::Standstill::new(&first);
        let give_up = rt::now().plus_ns(ROBOT_WITHIN_NS);
        while rt::now() < give_up {
            rt::sleep_until(rt::now().plus_ns(LOOK_NS));
            let measured = self.read(rt::now());
            let waited_ns = measured.stamp.since(first.stamp);
            if standstill.stands(&measured) || waited_ns >= driver::STANDS_WITHIN_TICKS * 1_000_000_000 / TICK_HZ {
                return Ok(());
            }
        }
        let text = "the robot fell silent: nothing says whether it stands. Look after `teleopd robot`, then start this one again";
        Err(Failure::new(Exit::Unavailable, text))
    }

    /// Takes two measurements, [`CONFIRM_NS`] apart.
    fn measure_twice(&mut self) -> (Measured, Measured) {
        let earlier = self.read(rt::now());
        rt::sleep_until(rt::now().plus_ns(CONFIRM_NS));
        (earlier, self.read(rt::now()))
    }

    /// If the driver was suspended while the robot moved, waits for a measurement made after now. Waits no longer
    /// than [`NEWS_WITHIN_NS`], and not beyond the time at which its pause latches. The robot may have been kept
    /// from its core too.
    fn wait_if_suspended(&mut self, state: &sim::DriverState, due_k: u64) {
        if due_k.saturating_sub(state.follower().index()) <= driver::GAP_MAX_TICKS || state.at_rest() {
            return;
        }
        let asked = rt::now();
        let latches = deadline(state.follower().index() + driver::SILENCE_TICKS);
        let news = asked.plus_ns(NEWS_WITHIN_NS);
        let give_up = if asked < latches { news.min(latches) } else { news };
        while self.newest.measured < asked && rt::now() < give_up {
            rt::sleep_until(rt::now().plus_ns(200_000));
            if let Some(newest) = rt::allocating_aside(|| self.measurements.latest()) {
                self.newest = newest;
            }
        }
    }
}

impl Driver for RemoteRobot {
    fn read(&mut self, _now: Stamp) -> Measured {
        if let Some(newest) = rt::allocating_aside(|| self.measurements.latest()) {
            self.newest = newest;
        }
        let RobotMeasured { measured, q, dq, flags, seen_k, .. } = self.newest;
        let has = |bit: u32| flags & bit != 0;
        let drives = Drives {
            emergency_stop: has(measured_flag::EMERGENCY_STOP),
            fault: has(measured_flag::DRIVE_FAULT),
            powered: has(measured_flag::POWERED),
        };
        Measured {
            stamp: measured,
            q,
            dq,
            drives,
            unanswered: self.sent_k > seen_k,
            refused: has(measured_flag::REFUSED),
        }
    }

    /// Sends a setpoint. Its answer comes with the next measurement, so the one read now belongs to an earlier
    /// setpoint. If the driver was suspended since `now`, it sends nothing. The robot is elsewhere then, and the
    /// next tick detects the pause.
    fn write(&mut self, now: Stamp, setpoint: &Setpoint, plan: &StopPlan) -> bool {
        if rt::now().since(now) > driver::GAP_MAX_TICKS * 1_000_000_000 / TICK_HZ {
            return true;
        }
        self.header.sequence += 1;
        self.header.stamp = now;
        let &Setpoint { k, q, v, a } = setpoint;
        let message = RobotSetpoint { header: self.header, k, q, v, a, plan: *plan };
        let sent = rt::allocating_aside(|| self.setpoints.publish(&message)).is_ok();
        if sent {
            self.sent_k = k;
        }
        sent && self.newest.flags & measured_flag::REFUSED == 0
    }
}

/// Runs until shutdown, then until the robot is at rest.
pub fn run(place: &InstanceArgs) -> Result<(), Failure> {
    let mut process = Process::start("sim", place, |loaded| Some(loaded.settings.realtime.priority_driver))?;
    let config = pipeline::sim_config(&process.loaded, process.realtime.is_realtime())
        .map_err(|error| Failure::new(Exit::Config, error))?;
    let seed = process.loaded.settings.sim.seed;
    let core = Domain::open(process.instance.core_domain(), "sim").map_err(bus_failure)?;
    let mut commands = core.waking_reader::<JointCommand>(Service::JointCommand).map_err(bus_failure)?;
    let mut states = core.writer::<RobotState>(Service::RobotState).map_err(bus_failure)?;

    warm_up(&config, seed);
    let grace_ns = (process.loaded.settings.driver.grace_us * 1e3) as u64;
    let due = |now: Stamp| tick_at(Stamp(now.0.saturating_sub(grace_ns)));
    // A tick ran for its index if a command was executed for it. A plan tick is a deadline that control missed.
    let mut timeline = Timeline::new();
    let polled = process.loaded.settings.realtime.hand_off == HandOff::Polled;
    let (mut sequence, mut oldest_command_ns) = (0, 0);
    // A starting driver holds the robot where it stands.
    let mut robot = RemoteRobot::find(&core, process.header(0, Stamp::NONE, Stamp::NONE))?;
    robot.wait_until_it_stands()?;
    let (earlier, measured) = robot.measure_twice();
    let mut state = sim::DriverState::new(&config, due(rt::now()) + 3, &earlier, &measured, seed)
        .ok_or_else(|| Failure::new(Exit::Unavailable, "the robot measures NaN or infinite positions"))?;
    process.ready()?;
    let mut ending: Option<Stamp> = None;
    loop {
        let now = rt::now();
        if process.shutdown.requested() {
            // After a request to end, the driver takes no more commands. It plays its plan and ends at rest.
            let since = *ending.get_or_insert(now);
            if state.at_rest() || now.since(since) > END_WITHIN_NS {
                break;
            }
        }
        let waited_for = state.follower().index() + 1;
        let give_up = deadline(waited_for).plus_ns(grace_ns);
        if polled {
            rt::sleep_until(give_up);
        } else if now < give_up {
            rt::allocating_aside(|| commands.wait(Duration::from_nanos(give_up.since(now))));
        }
        robot.wait_if_suspended(&state, due(rt::now()));
        let command = rt::allocating_aside(|| commands.latest()).filter(|_| ending.is_none());
        let now = rt::now();
        let input = sim::Input { due_k: due(now), command: command.as_ref() };
        let out = sim::drive(&config, &mut state, now, input, &mut robot);
        if out.advanced == 0 {
            continue;
        }
        if let Some(ticks) = out.suspended_ticks {
            process.stood_still(waited_for, ticks * 1_000_000_000 / TICK_HZ);
        }
        process.probe.record(Metric::WakeUp, deadline(waited_for), now);
        let mut message = out.state;
        sequence += 1;
        message.header = process.header(sequence, rt::now(), message.header.origin);
        process.publish(&mut states, &message);
        if let Some(command) = &command {
            note(&mut process.probe, now, command, &out);
        }
        if let Some(accepted) = out.accepted {
            let last = timeline.span().map_or(accepted.k, |(_, last)| last + 1);
            process.missed(accepted.k.saturating_sub(last));
            timeline.note(accepted.k);
            oldest_command_ns = oldest_command_ns.max(now.since(deadline(accepted.k)));
        }
        process.alive();
    }
    let report = figures(&process, &state, &timeline, oldest_command_ns);
    process.leave(report)
}

/// Runs warm-up ticks with a separate driver and robot.
fn warm_up(config: &sim::Config, seed: u64) {
    let mut state = sim::State::new(config, 0, seed);
    for k in 1..=WARM_TICKS {
        std::hint::black_box(sim::tick(config, &mut state, deadline(k), sim::Input { due_k: k, command: None }));
    }
}

/// Records the latency of the command that was executed at `now`.
fn note(probe: &mut Probe, now: Stamp, command: &JointCommand, out: &sim::Output) {
    let Some(accepted) = out.accepted else { return };
    probe.record(Metric::CommandToDriver, command.header.stamp, now);
    if let Some(age_ns) = accepted.origin_age_ns {
        probe.record_ns(Metric::SkeletonToCommand, now, age_ns);
    }
    // In other modes the command does not follow the target.
    let follows = [Mode::Engaging, Mode::Engaged].iter().any(|&mode| command.mode == mode as u32);
    if let Some(age_ns) = accepted.target_age_ns.filter(|_| follows) {
        probe.record_ns(Metric::TargetToCommand, now, age_ns);
    }
}

fn figures(process: &Process, state: &sim::DriverState, timeline: &Timeline, oldest_command_ns: u64) -> Value {
    let report = state.report();
    let violations: Map<_, _> =
        report.violations().iter().map(|&(kind, count)| (kind.to_owned(), json!(count))).collect();
    let mut figures = json!({
        "timeline": timeline.to_json(),
        "violations": violations,
        "min_clearance_mm": report.min_clearance_m() * 1e3,
        "torque_share_max": report.largest_torque_share().0,
        "engage": {
            "max_step_rad": report.engage_max_step_rad(),
            "first_second_velocity_ratio": report.engage_first_second_velocity_ratio(),
        },
        "rate_hz": TICK_HZ,
        "commands_accepted": state.follower().accepted,
        "oldest_command_us": oldest_command_ns as f64 * 1e-3,
        "ended_at_rest": state.at_rest(),
        "first_latch": state.first_latch(),
        "interface": process.loaded.settings.sim.interface.name(),
    });
    if let Some(delays_s) = state.delays_s() {
        figures["controller_delays_ms"] = json!(delays_s.map(|delay_s| delay_s * 1e3));
    }
    figures
}
