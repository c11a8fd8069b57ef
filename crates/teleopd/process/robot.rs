//! The simulated robot, with its own clock and watchdog. Takes setpoints from the driver as if from a
//! field bus. Moves the joints, measures them, and judges their true motion.

use super::{Process, WARM_TICKS, bus_failure};
use crate::cli::InstanceArgs;
use crate::timeline::Timeline;
use bus::Domain;
use messages::{Layout, RobotMeasured, RobotSetpoint, Service, Stamp, deadline, measured_flag, tick_at};
use plant::Robot;
use rt::{Exit, Failure};
use serde_json::{Map, Value, json};
use telemetry::Metric;

/// Cycle of the port, ns: 1 ms, as with EtherCAT in many robots.
const CYCLE_NS: u64 = 1_000_000;

/// After a request to end, the robot continues until its joints stand still, but no longer than this: twice the
/// longest stop.
const END_WITHIN_NS: u64 = 1_000_000_000;

/// Time between two looks at the shutdown flag of a robot that simulates nothing, ns.
const STAND_BY_NS: u64 = 50_000_000;

/// A joint slower than this stands still, rad/s or m/s: a hundredth of an arm's largest speed. Assumption.
const STANDING: f64 = 0.01;

/// Runs until shutdown, then until the joints stand still.
pub fn run(place: &InstanceArgs) -> Result<(), Failure> {
    let mut process = Process::start("robot", place, |loaded| Some(loaded.settings.realtime.priority_driver))?;
    if process.loaded.driver_program().is_some() {
        return stand_by(process);
    }
    let (config, initial) = world::robot_config(&process.loaded).map_err(Failure::with(Exit::Config))?;
    let seed = process.loaded.settings.sim.seed;
    let core = Domain::open(process.instance.core_domain(), "robot").map_err(bus_failure)?;
    let mut setpoints = core.reader::<RobotSetpoint>(Service::RobotSetpoint).map_err(bus_failure)?;
    let mut measurements = core.writer::<RobotMeasured>(Service::RobotMeasured).map_err(bus_failure)?;

    let mut warm = Robot::new(&config, deadline(0), &initial, seed);
    for k in 1..=WARM_TICKS {
        std::hint::black_box(warm.measure(&config, deadline(k)));
    }
    let (mut robot, id) = (Robot::new(&config, rt::now(), &initial, seed), process.loaded.model.id());
    // The button of the simulated emergency stop. `teleopd commission` asks a person to press it.
    let button = rt::Switch::on_signals().map_err(Failure::with(Exit::Software))?;
    process.ready()?;
    let (mut cycle, mut sequence, mut seen_k, mut refused) = (rt::now(), 0, 0, false);
    let mut timeline = Timeline::new();
    let mut ending: Option<Stamp> = None;
    loop {
        cycle = cycle.plus_ns(CYCLE_NS);
        rt::sleep_until(cycle);
        let now = rt::now();
        process.probe.record(Metric::WakeUp, cycle, now);
        let is_late = now.since(cycle) > CYCLE_NS;
        // Missed cycles are skipped. The body moves on through them.
        cycle = if is_late { now } else { cycle };
        timeline.add_until(tick_at(now), is_late);
        press(&mut robot, button.turned());
        // Each setpoint acts at the time at which it was sent, whenever this process woke up or slept. One answer covers
        // all setpoints of a cycle. It is a refusal if one of them was refused.
        let (mut answer, mut newest) = (None, now);
        rt::allocating_aside(|| {
            setpoints.drain(|sample| {
                let RobotSetpoint { header, robot: addressee, k, q, v, a, plan, grippers } = sample.message;
                let sent = header.stamp.min(rt::now());
                newest = newest.max(sent);
                // A setpoint for another robot is refused like one that jumps.
                let taken = addressee == id && robot.receive(&config, sent, &plant::Setpoint { k, q, v, a, plan });
                if taken {
                    robot.grip(&grippers);
                }
                answer = Some(answer.unwrap_or(false) || !taken);
                seen_k = k;
            })
        });
        refused = answer.unwrap_or(refused);
        let measured = robot.measure(&config, newest);
        sequence += 1;
        let header = process.header(sequence, rt::now(), Stamp::NONE);
        let flags = flags(&measured, refused);
        let grippers = robot.gripped(&config, now);
        let answer = RobotMeasured { header, robot: id, seen_k, flags, grippers, ..RobotMeasured::ZERO };
        process.publish(&mut measurements, &message(&measured, answer));
        process.alive();
        if process.shutdown.requested() {
            let since = *ending.get_or_insert(now);
            let stands = robot.truth().v.iter().all(|v| v.abs() <= STANDING);
            if stands || now.since(since) > END_WITHIN_NS {
                break;
            }
        }
    }
    let mut report = figures(&process.loaded.model.joint_names, &robot);
    report["timeline"] = json!(timeline);
    process.leave(report)
}

fn press(robot: &mut Robot, turned: Option<bool>) {
    use plant::Injection::{EmergencyStopPressed, EmergencyStopReleased};
    if let Some(pressed) = turned {
        robot.inject(if pressed { EmergencyStopPressed } else { EmergencyStopReleased });
    }
}

/// A driver with a program of its own brings its own robot. This process then simulates nothing.
fn stand_by(mut process: Process) -> Result<(), Failure> {
    process.ready()?;
    while !process.shutdown.requested() {
        rt::sleep_until(rt::now().plus_ns(STAND_BY_NS));
        process.alive();
    }
    process.leave(json!({}))
}

fn message(from: &plant::Measured, message: RobotMeasured) -> RobotMeasured {
    RobotMeasured { measured: from.stamp, q: from.q, dq: from.dq, tau: from.tau, ..message }
}

fn flags(measured: &plant::Measured, refused: bool) -> u32 {
    let drives = measured.drives;
    [
        (drives.emergency_stop, measured_flag::EMERGENCY_STOP),
        (drives.fault, measured_flag::DRIVE_FAULT),
        (drives.powered, measured_flag::POWERED),
        (measured.reacting, measured_flag::REACTING),
        (refused, measured_flag::REFUSED),
    ]
    .into_iter()
    .filter_map(|(present, bit)| present.then_some(bit))
    .sum()
}

fn figures(joint_names: &[String], robot: &Robot) -> Value {
    let judged = robot.judged();
    let violations: Map<_, _> =
        plant::ViolationKind::ALL.map(|kind| (kind.name().to_owned(), json!(judged.count(kind)))).into_iter().collect();
    let greatest = |ratios: &[f64]| ratios.iter().copied().fold(0.0, f64::max);
    let first = judged.first.map(|first| {
        let name = joint_names.get(first.which).filter(|_| first.kind != plant::ViolationKind::Clearance);
        json!({
            "kind": first.kind.name(), "which": first.which, "joint": name, "at_s": first.at.0 as f64 * 1e-9,
            "value": first.value, "bound": first.bound,
        })
    });
    json!({
        "violations": violations,
        "first_violation": first,
        "looks": judged.looks,
        "setpoints": judged.setpoints,
        "min_clearance_mm": judged.clearance_min_m * 1e3,
        "speed_ratio_max": greatest(&judged.speed_ratio_max),
        "effort_ratio_max": greatest(&judged.effort_ratio_max),
    })
}
