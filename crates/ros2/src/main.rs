//! The program `teleopd-ros2`: the driver of a robot that speaks ROS 2, and its preflight.

use clap::Parser;
use ros2::link::{Command, Link};
use ros2::port::Ros2;
use ros2::preflight;
use rt::{Exit, Failure};
use std::path::PathBuf;
use std::process::ExitCode;

/// Check a robot on ROS 2 before it is driven: controllers, description, joint states, emergency stop, posture.
/// Nothing is sent. Exits with 1 if a check failed
#[derive(Parser)]
#[command(name = "teleopd-ros2 preflight", version)]
struct Preflight {
    /// Settings file.
    #[arg(long, default_value_os_t = instance::default_config())]
    config: PathBuf,
    /// Another robot than that of the settings: its name, or its robot file.
    #[arg(long, value_name = "NAME|FILE")]
    robot: Option<config::RobotChoice>,
    /// Also print the messages that would be sent to the robot as it stands.
    #[arg(long)]
    dry_run: bool,
}

fn main() -> ExitCode {
    let mut words = std::env::args_os();
    if words.nth(1).is_some_and(|word| word == "preflight") {
        let program = std::iter::once("preflight".into());
        return rt::finish("teleopd-ros2", preflight(&Preflight::parse_from(program.chain(words))));
    }
    teleopd::drive_configured(Ros2::open)
}

fn preflight(options: &Preflight) -> Result<Exit, Failure> {
    let overrides = config::Overrides::robot(options.robot.as_ref());
    let (settings, model) = config::load_robot(&options.config, &overrides).map_err(Failure::with(Exit::Config))?;
    let (model, settings) = (&model, &settings.ros2);
    let mut link = Link::open(model, settings).map_err(|cause| Failure::new(Exit::Unavailable, cause))?;
    let failures = preflight::judge(&mut link, model, !settings.emergency_stop_topic.is_empty());
    for seen in link.controllers(rt::now()) {
        let activity = if seen.active { "active" } else { "silent" };
        println!("{}: {activity}, {} readers, {} other publishers", seen.topic, seen.readers, seen.publishers);
    }
    if let (true, Some(heard)) = (options.dry_run, &link.heard) {
        let motion = driver::Motion::rest(heard.sample.q);
        let command = Command { k: messages::tick_at(rt::now()), motion };
        for message in link.messages(&command).into_iter().flatten() {
            println!("{message:#?}");
        }
    }
    for failure in &failures {
        println!("failed: {failure}");
    }
    if failures.is_empty() {
        println!("{} may be driven", model.name);
    }
    Ok(if failures.is_empty() { Exit::Ok } else { Exit::Failed })
}
