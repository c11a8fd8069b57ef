//! The checks before a robot may be driven. Each failure is one sentence with what to do.

use crate::connection::Connection;
use crate::description::difference;
use crate::reference::HELD;
use config::Ros2Settings;
use messages::JOINTS_MAX;
use robot::Model;
use safety::monitor;

/// Longest wait for the robot's topics, ns. DDS finds a robot within some seconds.
const WAIT_NS: u64 = 10_000_000_000;
/// Time for which the robot is watched once it is found, ns.
const WATCH_NS: u64 = 1_000_000_000;
/// Time between two looks, ns.
const STEP_NS: u64 = 2_000_000;
/// Least and largest rate of joint states, Hz. Controllers of PAL's robots publish at 50, and the estimate between two
/// samples is made for no less. Those of Reachy 2 publish at 500, and a Unitree robot does (assumption).
const RATES_HZ: [f64; 2] = [45.0, 110.0];
const RATES_FAST_HZ: [f64; 2] = [45.0, 1100.0];
/// A state that is older than this stands, ns.
const STATE_SILENT_NS: u64 = 100_000_000;
/// A standing joint stays within this, rad or m. It is the band in which `safety` judges rest.
const STANDS: f64 = 0.005;

/// Waits for the robot and judges it. Returns the sentences of all checks that failed. A robot of which nothing is heard
/// has one sentence only, because all others would follow from it.
pub fn judge(connection: &mut Connection, model: &Model, settings: &Ros2Settings) -> Vec<String> {
    let wants_emergency_stop = !settings.emergency_stop_topic.is_empty();
    let began = rt::now();
    while rt::now().since(began) < WAIT_NS && !is_complete(connection, wants_emergency_stop) {
        step(connection);
    }
    let (mut lowest, mut highest) = ([f64::INFINITY; JOINTS_MAX], [-f64::INFINITY; JOINTS_MAX]);
    let mut stamps = Vec::new();
    let began = rt::now();
    while rt::now().since(began) < WATCH_NS {
        step(connection);
        if let Some(heard) = &connection.latest {
            if stamps.last() != Some(&heard.stamp_ns) {
                stamps.push(heard.stamp_ns);
            }
            for j in 0..JOINTS_MAX {
                lowest[j] = lowest[j].min(heard.sample.q[j]);
                highest[j] = highest[j].max(heard.sample.q[j]);
            }
        }
    }
    if nothing_heard(connection) {
        return vec![nothing(settings)];
    }
    let mut failures = controllers(connection);
    failures.extend(emergency_stop(connection, wants_emergency_stop));
    if connection.is_ros() {
        failures.extend(description(connection.urdf.as_deref(), model));
    } else {
        failures.extend(robot_type(connection.mode_machine, model));
    }
    let states = if connection.is_ros() { "joint_states" } else { "rt/lowstate" };
    match &connection.latest {
        Some(heard) => {
            let rate_hz = rate_hz(&stamps);
            let [least, most] = if connection.has_states() { RATES_HZ } else { RATES_FAST_HZ };
            if rt::now().since(heard.sample.measured) > STATE_SILENT_NS {
                failures.push(format!("{states} fell silent, or its tick stands: check the robot's controller"));
            } else if !(least..=most).contains(&rate_hz) {
                failures.push(format!(
                    "{states} comes at {rate_hz:.0} Hz, must be {least} to {most}: set the update rate of the robot's joint state broadcaster"
                ));
            }
            failures.extend(moving(model, &lowest, &highest));
            failures.extend(posture(model, &heard.sample.q));
            if connection.controllers(rt::now()).iter().all(|seen| seen.active && !seen.other_joints) {
                failures.extend(held(model, &connection.held(), &heard.sample.q));
            }
        }
        None => failures.push(connection.incomplete.clone().map_or_else(
            || {
                if !connection.is_ros() {
                    return "no rt/lowstate arrived: check ros2.domain_id and ros2.interface, and that the robot is on".to_owned();
                }
                "no joint_states arrived: check ros2.domain_id, ros2.interface and ros2.joint_states_topic, and that the \
                 robot's joint state broadcaster is active"
                    .to_owned()
            },
            |incomplete| format!("{incomplete}: the robot file names a joint that this robot does not report"),
        )),
    }
    if connection.rejected_stamps > 0 {
        failures.push(format!(
            "{} stamps of {states} were more than 20 ms off the others: synchronise the robot's clock, and do not step it",
            connection.rejected_stamps
        ));
    }
    failures
}

fn nothing_heard(connection: &Connection) -> bool {
    let state = connection.latest.is_some() || connection.incomplete.is_some() || connection.rejected_stamps > 0;
    let other = connection.urdf.is_some() || connection.pressed.is_some();
    !state && !other && !connection.has_company()
}

fn nothing(settings: &Ros2Settings) -> String {
    let interface = match settings.interface.as_str() {
        "" => "any network interface",
        name => &format!("network interface `{name}`"),
    };
    format!(
        "nothing was heard of a robot in domain {} on {interface}: switch the robot on, set ros2.domain_id to its DDS \
         domain (ROS_DOMAIN_ID) and ros2.interface to the interface that leads to it, and let the network pass multicast",
        settings.domain_id
    )
}

fn step(connection: &mut Connection) {
    connection.receive(rt::now());
    rt::sleep_until(rt::now().plus_ns(STEP_NS));
}

fn is_complete(connection: &Connection, wants_emergency_stop: bool) -> bool {
    let found = connection.controllers(rt::now()).iter().all(|seen| seen.active && seen.readers > 0);
    let described = connection.urdf.is_some() || !connection.is_ros();
    found && connection.latest.is_some() && described && (connection.pressed.is_some() || !wants_emergency_stop)
}

/// The rate by the median time between two stamps, Hz. The median does not feel what the network loses.
fn rate_hz(stamps_ns: &[i64]) -> f64 {
    let mut gaps_ns: Vec<i64> = stamps_ns.windows(2).map(|pair| pair[1] - pair[0]).collect();
    gaps_ns.sort_unstable();
    gaps_ns.get(gaps_ns.len() / 2).map_or(0.0, |gap_ns| 1e9 / *gap_ns as f64)
}

fn controllers(connection: &Connection) -> Vec<String> {
    let mut failures = Vec::new();
    for seen in connection.controllers(rt::now()) {
        let name = &seen.name;
        if !seen.active {
            failures.push(format!(
                "controller `{name}` publishes no state: activate it (ros2 control switch_controllers --activate {name}), or correct the robot file's [[controllers]]"
            ));
        } else if seen.other_joints {
            failures.push(format!(
                "controller `{name}` has other joints than the robot file names: correct its [[controllers]]"
            ));
        }
        if seen.readers == 0 {
            failures.push(format!("nobody reads {}: start the robot's controller `{name}`", seen.topic));
        } else if seen.readers > 1 {
            failures.push(format!(
                "{} has {} readers, must have one: run one robot in this domain",
                seen.topic, seen.readers
            ));
        }
        if seen.publishers > 0 {
            failures.push(format!(
                "another program may send to {}: stop it (play_motion, a joystick, another teleopd)",
                seen.topic
            ));
        }
    }
    failures
}

fn emergency_stop(connection: &Connection, wanted: bool) -> Option<String> {
    match connection.pressed {
        Some(true) => Some("the emergency stop is pressed: release it when the robot's surroundings are clear".to_owned()),
        None if wanted => Some(
            "no message on ros2.emergency_stop_topic: name the robot's topic, or set it to \"\" for a robot that has none"
                .to_owned(),
        ),
        _ => None,
    }
}

fn description(urdf: Option<&str>, model: &Model) -> Option<String> {
    let missing = || "no /robot_description arrived: start the robot's state publisher".to_owned();
    urdf.map_or_else(|| Some(missing()), |urdf| difference(urdf, model))
}

fn robot_type(found: Option<u8>, model: &Model) -> Option<String> {
    let (found, wanted) = (found?, model.driver.mode_machine?);
    (found != wanted).then(|| {
        format!("rt/lowstate has mode_machine {found}, the robot file {wanted}: this is another robot, or its waist is locked")
    })
}

fn moving(model: &Model, lowest: &[f64; JOINTS_MAX], highest: &[f64; JOINTS_MAX]) -> Option<String> {
    let joint = (0..model.count).find(|&j| highest[j] - lowest[j] > STANDS)?;
    Some(format!("`{}` moves: wait until the robot stands, and stop what moves it", model.joint_names[joint]))
}

fn held(model: &Model, reference: &[f64; JOINTS_MAX], q: &[f64; JOINTS_MAX]) -> Option<String> {
    let joint = (0..model.count).find(|&j| !((reference[j] - q[j]).abs() <= HELD))?;
    let (name, off) = (&model.joint_names[joint], q[joint] - reference[joint]);
    Some(format!(
        "`{name}` is {off:.3} from its controller's setpoint: let the controller take the posture that it has"
    ))
}

fn posture(model: &Model, q: &[f64; JOINTS_MAX]) -> Option<String> {
    if let Some(outside) = monitor::outside_limits(model, q) {
        let name = &model.joint_names[outside.joint];
        return Some(format!("`{name}` stands {:.3} beyond its limit: move the robot by its own means", outside.by));
    }
    let clearance = monitor::measured_clearance(model, &mut robot::Frames::default(), q);
    let near = !clearance.is_at_least(model.d_min_m);
    near.then(|| {
        let [a, b] = clearance.pair.map(|capsule| &model.capsules[capsule as usize].name);
        let distance_mm = clearance.distance_m * 1e3;
        format!("{a} and {b} are {distance_mm:.0} mm apart, too close to begin: move the robot by its own means")
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rate_is_that_of_the_sender_however_much_is_lost() {
        let period_ns = 20_000_000;
        let arrived =
            |lost: &dyn Fn(i64) -> bool| (0..50).filter(|n| !lost(*n)).map(|n| n * period_ns).collect::<Vec<_>>();
        assert_eq!(rate_hz(&arrived(&|_| false)), 50.0);
        assert_eq!(rate_hz(&arrived(&|n| n % 4 == 1)), 50.0);
        assert_eq!(rate_hz(&arrived(&|n| n % 2 == 1)), 25.0, "a sender of half the rate");
        assert_eq!((rate_hz(&[]), rate_hz(&[5])), (0.0, 0.0));
    }
}
