//! The process of a driver, for any robot: executes a command when it arrives, or the plan when none does, and hands
//! every setpoint to a [`Driver`].

use super::{Process, WARM_TICKS, bus_failure};
use crate::cli::InstanceArgs;
use crate::timeline::Timeline;
use bus::{Domain, WakingReader};
use config::{DriverKind, HandOff};
use driver::{DriveInput, DriveOutput, Driver, Drives, Interface, Measured, Setpoint};
use messages::{
    GripperMotion, GripperState, JOINTS_MAX, JointCommand, Mode, RobotState, Service, Stamp, StopPlan, TICK_HZ,
    deadline, tick_at,
};
use rt::{Exit, Failure};
use serde_json::{Map, Value, json};
use std::time::Duration;
use telemetry::{Event, Metric, Probe};

/// Time between the two measurements of a starting driver, ns. The second must confirm the speeds of the first.
const CONFIRM_NS: u64 = 6_000_000;

/// Time between two reads of the robot, ns. A port of 1 kHz measures once in it.
pub(super) const LOOK_NS: u64 = 1_000_000;

/// After a request to end, the driver plays its plan to rest, but no longer than this. The longest stop is 0.5 s, and
/// this is twice that.
const END_WITHIN_NS: u64 = 1_000_000_000;

/// Longest time that a starting driver waits for the robot to measure, ns.
pub(super) const ANSWERS_WITHIN_NS: u64 = 2_000_000_000;

/// Longest time that a suspended driver waits for a current measurement, ns: 20 cycles of a port of 1 kHz.
const NEWS_WITHIN_NS: u64 = 20_000_000;

/// Waits until a robot whose last driver has just died has reacted by itself, and stands, or does not come to stand for a second
/// of its own time.
fn wait_until_it_stands(robot: &mut impl Driver) -> Result<(), Failure> {
    let mut standstill = driver::Standstill::new(&robot.read(rt::now()));
    let give_up = rt::now().plus_ns(ANSWERS_WITHIN_NS);
    while rt::now() < give_up {
        rt::sleep_until(rt::now().plus_ns(LOOK_NS));
        if standstill.is_over(&robot.read(rt::now())) {
            return Ok(());
        }
    }
    let text = "the robot stopped sending measurements, so it may still move. Check it, then start this driver again";
    Err(Failure::new(Exit::Unavailable, text))
}

/// Waits until the robot stands, and begins to hold it there.
fn begin(
    config: &checker::Config,
    robot: &mut impl Driver,
    due: impl Fn(Stamp) -> u64,
    seed: u64,
) -> Result<checker::State, Failure> {
    wait_until_it_stands(robot)?;
    let earlier = robot.read(rt::now());
    rt::sleep_until(rt::now().plus_ns(CONFIRM_NS));
    let measured = robot.read(rt::now());
    checker::State::new(config, due(rt::now()) + 3, &earlier, &measured, seed)
        .ok_or_else(|| Failure::new(Exit::Unavailable, "the robot measures NaN or infinite positions"))
}

/// Waits for a new command until `give_up`. A polled reader waits for that time in any case.
fn wait_for_command(commands: &mut WakingReader<JointCommand>, give_up: Stamp, polled: bool) {
    let now = rt::now();
    if polled {
        rt::sleep_until(give_up);
    } else if now < give_up {
        rt::allocating_aside(|| commands.wait(Duration::from_nanos(give_up.since(now))));
    }
}

/// If the driver was suspended while the robot moved, waits for a measurement made after now. Waits no longer than
/// [`NEWS_WITHIN_NS`], and not beyond the time at which its pause latches. The robot may have been kept from its core too.
fn wait_if_suspended(robot: &mut impl Driver, state: &checker::State, due_k: u64) {
    if due_k.saturating_sub(state.follower().index()) <= driver::GAP_MAX_TICKS || state.at_rest() {
        return;
    }
    let asked = rt::now();
    let latches = deadline(state.follower().index() + driver::SILENCE_TICKS);
    let news = asked.plus_ns(NEWS_WITHIN_NS);
    let give_up = if asked < latches { news.min(latches) } else { news };
    while rt::now() < give_up && robot.read(rt::now()).stamp < asked {
        rt::sleep_until(rt::now().plus_ns(200_000));
    }
}

/// The settings of the driver, and of the checker of its steps. A real robot needs real-time rights. Only the built-in
/// robot has simulated controllers: other drivers send what whole-body control certified. `declared` is the interface that a
/// driver's own program declares. None is the simulated robot, which has every interface.
fn config(process: &Process, declared: Option<Interface>) -> Result<checker::Config, Failure> {
    let (loaded, realtime) = (&process.loaded, process.realtime.is_realtime());
    if let Some(declared) = declared {
        let refused = |cause: String| Failure::new(Exit::Config, format!("{}: {cause}", loaded.config_name()));
        loaded.settings.check_declared(declared).map_err(refused)?;
    }
    if loaded.settings.driver.kind == DriverKind::Robot && !realtime {
        let refusals = process.realtime.refusals().join("; ");
        let text =
            format!("driver.kind = \"robot\": the driver of a real robot needs real-time scheduling: {refusals}");
        return Err(Failure::new(Exit::Unavailable, text));
    }
    let config = world::driver_config(loaded, realtime).map_err(Failure::with(Exit::Config))?;
    Ok(if loaded.driver_program().is_some() { config.without_simulated_controllers() } else { config })
}

/// A robot that gets no setpoint of before a pause. If the process was suspended since `now`, or `read` took too long,
/// nothing is sent. The robot is elsewhere then, and the next tick detects the pause.
struct Fresh<D>(D);

impl<D: Driver> Driver for Fresh<D> {
    fn read(&mut self, now: Stamp) -> Measured {
        self.0.read(now)
    }

    fn write(&mut self, now: Stamp, setpoint: &Setpoint, plan: &StopPlan) -> bool {
        rt::now().since(now) > driver::GAP_MAX_TICKS * 1_000_000_000 / TICK_HZ || self.0.write(now, setpoint, plan)
    }

    fn grip(&mut self, grippers: &GripperMotion) {
        self.0.grip(grippers);
    }

    fn gripped(&self) -> Option<GripperState> {
        self.0.gripped()
    }
}

/// Opens the robot, drives it until shutdown, and then until it is at rest. `declared` is the interface that a driver's own
/// program declares.
pub fn run<D: Driver>(
    place: &InstanceArgs,
    declared: Option<Interface>,
    open: impl FnOnce(&Process, &Domain) -> Result<D, Failure>,
) -> Result<(), Failure> {
    let mut process = Process::start("driver", place, |loaded| Some(loaded.settings.realtime.priority_driver))?;
    let (config, seed) = (config(&process, declared)?, process.loaded.settings.sim.seed);
    let core = Domain::open(process.instance.core_domain(), "driver").map_err(bus_failure)?;
    let mut commands = core.waking_reader::<JointCommand>(Service::JointCommand).map_err(bus_failure)?;
    let mut states = core.writer::<RobotState>(Service::RobotState).map_err(bus_failure)?;

    warm_up(&config, process.loaded.model.home, seed);
    let grace_ns = (process.loaded.settings.driver.grace_us * 1e3) as u64;
    let due = |now: Stamp| tick_at(Stamp(now.0.saturating_sub(grace_ns)));
    // A tick ran for its index if a command was executed for it. A plan tick is a deadline that control missed.
    let mut timeline = Timeline::new();
    let polled = process.loaded.settings.realtime.hand_off == HandOff::Polled;
    let (mut sequence, mut oldest_command_ns, mut oldest_measured_ns) = (0, 0, 0);
    // A starting driver holds the robot where it stands.
    let mut robot = Fresh(open(&process, &core)?);
    let mut state = begin(&config, &mut robot, due, seed)?;
    process.ready()?;
    let (mut latched, mut ending) = (false, None);
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
        wait_for_command(&mut commands, deadline(waited_for).plus_ns(grace_ns), polled);
        wait_if_suspended(&mut robot, &state, due(rt::now()));
        let command = rt::allocating_aside(|| commands.latest()).filter(|_| ending.is_none());
        let now = rt::now();
        let input = DriveInput { due_k: due(now), command: command.as_ref() };
        let out = checker::drive(&config, &mut state, now, input, &mut robot);
        if out.advanced == 0 {
            continue;
        }
        if let Some(ticks) = out.suspended_ticks {
            process.stood_still(waited_for, ticks * 1_000_000_000 / TICK_HZ);
            process.missed(ticks);
            // It ends the pause, even if the driver latched and executes no command again.
            timeline.add(state.follower().index());
        }
        oldest_measured_ns = oldest_measured_ns.max(now.since(state.measured().stamp));
        log_latch(&mut process.probe, state.first_latch(), &mut latched);
        process.probe.record(Metric::WakeUp, deadline(waited_for), now);
        let mut message = out.state;
        sequence += 1;
        message.header = process.header(sequence, rt::now(), message.header.origin);
        process.publish(&mut states, &message);
        if let Some(command) = &command {
            record_latency(&mut process.probe, now, command, &out);
        }
        if let Some(accepted) = out.accepted {
            let last = timeline.span().map_or(accepted.k, |(_, last)| last + 1);
            process.missed(accepted.k.saturating_sub(last));
            timeline.add(accepted.k);
            oldest_command_ns = oldest_command_ns.max(now.since(deadline(accepted.k)));
        }
        process.alive();
    }
    let report = figures(&process, &state, &timeline, [oldest_command_ns, oldest_measured_ns]);
    process.leave(report)
}

fn log_latch(probe: &mut Probe, cause: Option<&'static str>, logged: &mut bool) {
    if let Some(cause) = cause.filter(|_| !std::mem::replace(logged, true)) {
        probe.event(Event::Latched { cause });
    }
}

/// A robot that stays where it is.
struct Still([f64; JOINTS_MAX]);

impl Driver for Still {
    fn read(&mut self, now: Stamp) -> Measured {
        let (q, dq) = (self.0, [0.0; JOINTS_MAX]);
        Measured { stamp: now, q, dq, drives: Drives::SOUND, unanswered: false, refused: false }
    }

    fn write(&mut self, _: Stamp, _: &Setpoint, _: &StopPlan) -> bool {
        true
    }
}

/// Runs warm-up ticks with a driver of their own, on a robot that stays at `q`.
fn warm_up(config: &checker::Config, q: [f64; JOINTS_MAX], seed: u64) {
    let mut robot = Still(q);
    let measured = robot.read(deadline(0));
    let Some(mut state) = checker::State::new(config, 0, &measured, &measured, seed) else { return };
    for k in 1..=WARM_TICKS {
        let input = DriveInput { due_k: k, command: None };
        std::hint::black_box(checker::drive(config, &mut state, deadline(k), input, &mut robot));
    }
}

fn record_latency(probe: &mut Probe, now: Stamp, command: &JointCommand, out: &DriveOutput) {
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

fn figures(
    process: &Process,
    state: &checker::State,
    timeline: &Timeline,
    [command_ns, measured_ns]: [u64; 2],
) -> Value {
    let report = state.report();
    let violations: Map<_, _> =
        report.violations().iter().map(|&(kind, count)| (kind.to_owned(), json!(count))).collect();
    let mut figures = json!({
        "timeline": timeline,
        "violations": violations,
        "min_clearance_mm": report.min_clearance_m * 1e3,
        "torque_share_max": report.largest_torque_share().0,
        "engage": {
            "max_step_rad": report.engage_max_step_rad,
            "first_second_velocity_ratio": report.engage_first_second_velocity_ratio,
        },
        "rate_hz": TICK_HZ,
        "commands_accepted": state.follower().accepted,
        "oldest_command_us": command_ns as f64 * 1e-3,
        "oldest_measured_ms": measured_ns as f64 * 1e-6,
        "ended_at_rest": state.at_rest(),
        "first_latch": state.first_latch(),
        "interface": process.loaded.settings.interface().name(),
    });
    if let Some(delays_s) = state.delays_s() {
        figures["controller_delays_ms"] = json!(delays_s.iter().map(|delay_s| delay_s * 1e3).collect::<Vec<_>>());
    }
    figures
}

#[cfg(test)]
mod tests {
    use super::*;
    use messages::Layout;

    /// A robot that counts what it is sent.
    struct Counting(u32);

    impl Driver for Counting {
        fn read(&mut self, now: Stamp) -> Measured {
            Still([0.0; JOINTS_MAX]).read(now)
        }

        fn write(&mut self, _: Stamp, _: &Setpoint, _: &StopPlan) -> bool {
            self.0 += 1;
            false
        }
    }

    #[test]
    fn setpoint_of_before_a_pause_is_not_sent() {
        let mut robot = Fresh(Counting(0));
        let setpoint = Setpoint { k: 1, q: [0.0; JOINTS_MAX], v: [0.0; JOINTS_MAX], a: [0.0; JOINTS_MAX] };
        let before = Stamp(rt::now().0 - 10_000_000);
        assert!(robot.write(before, &setpoint, &StopPlan::ZERO), "a pause is no refusal");
        assert_eq!(robot.0.0, 0);
        // A stamp of the future is as young as can be, however loaded the machine is.
        let after = rt::now().plus_ns(1_000_000_000);
        assert!(!robot.write(after, &setpoint, &StopPlan::ZERO) && robot.0.0 == 1);
    }
}
