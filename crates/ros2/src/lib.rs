//! Drives a robot that speaks DDS, without an installation of ROS: trajectory controllers of ROS 2 (Humble), controllers that
//! take positions, or the arms of a Unitree robot.

#![allow(clippy::neg_cmp_op_on_partial_ord, reason = "NaN differs from everything")]
#![allow(clippy::needless_range_loop, reason = "a joint index runs over several arrays at once")]

pub mod cli;
mod clock;
mod connection;
mod curves;
mod dds;
mod description;
mod discovery;
mod emergency;
mod estimate;
mod gravity;
mod hands;
mod interface;
mod lag;
mod port;
mod preflight;
mod reference;
mod ros;
mod states;
mod stream;
mod trajectory;
mod unitree;
mod wire;

use clap::Parser;
use cli::{Cli, Command, Preflight};
use connection::Connection;
use interface::{INTERFACE, disagreement};
use rt::{Exit, Failure};
use std::process::ExitCode;

/// Runs the program `teleopd-ros2`: the driver of a robot that speaks DDS, its preflight, or the states of an instance.
pub fn main() -> ExitCode {
    if std::env::args_os().nth(1).is_some_and(|word| word == "preflight" || word == "states") {
        let command = Cli::parse().command;
        end_on_panic();
        return match command {
            Command::Preflight(options) => rt::finish("teleopd-ros2", preflight(&options)),
            Command::States(options) => rt::finish("teleopd-ros2", states::publish(&options)),
        };
    }
    teleopd::drive_configured(INTERFACE, port::Ros2::open)
}

/// Ends the program when a thread of DDS panics. Calls into DDS would wait for ever then.
fn end_on_panic() {
    let print_panic = std::panic::take_hook();
    std::panic::set_hook(Box::new(move |panic| {
        print_panic(panic);
        rt::err!(
            "teleopd-ros2: DDS failed. If /robot_description is larger than 340 kB, give sockets more memory: \
             sysctl -w net.core.rmem_max=4194304"
        );
        std::process::exit(Exit::Unavailable as i32);
    }));
}

fn preflight(options: &Preflight) -> Result<Exit, Failure> {
    let overrides = config::Overrides::robot(options.robot.as_ref());
    let (settings, model) = config::load_robot(&options.config, &overrides).map_err(Failure::with(Exit::Config))?;
    if let Some(disagreement) = disagreement(&settings, &model) {
        return Err(Failure::new(Exit::Config, format!("{}: {disagreement}", options.config.display())));
    }
    let (model, interface, settings) = (&model, settings.ros2.setpoints, &settings.ros2);
    let mut connection =
        Connection::open(model, settings, interface, false).map_err(|cause| Failure::new(Exit::Unavailable, cause))?;
    let failures = preflight::judge(&mut connection, model, settings);
    for seen in connection.controllers(rt::now()) {
        let activity = match (connection.has_states(), seen.active) {
            (false, _) => "activity unknown",
            (true, true) => "active",
            (true, false) => "silent",
        };
        rt::out!("{}: {activity}, {} readers, {} other publishers", seen.topic, seen.readers, seen.publishers);
    }
    connection.describe_hands();
    for (name, hindrance) in connection.hindered_hands(rt::now()) {
        match hindrance {
            Some(why) => rt::out!("{name}: the gripper is not driven: {why}"),
            None => rt::out!("{name}: the gripper may be driven"),
        }
    }
    if let (true, Some(heard)) = (options.dry_run, &connection.latest) {
        let motion = messages::JointMotion::rest(heard.sample.q);
        let command = trajectory::Command { k: messages::tick_at(rt::now()), motion };
        let messages = connection.messages(&command).unwrap_or_default();
        for (seen, message) in connection.controllers(rt::now()).iter().zip(messages) {
            rt::out!("{} would get\n{message}", seen.topic);
        }
    }
    for failure in &failures {
        rt::out!("failed: {failure}");
    }
    if failures.is_empty() {
        rt::out!("{} may be driven", model.name);
    }
    Ok(if failures.is_empty() { Exit::Ok } else { Exit::Failed })
}
