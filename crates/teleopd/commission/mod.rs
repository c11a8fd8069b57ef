//! The first hour with a robot: preflight, emergency stop, each joint alone, `kill -9` of every process, delay. The steps
//! are plain functions over a robot and a person (`session`). The robot of a run is `live`, the person is at `console`.

mod console;
mod description;
mod emergency;
mod joints;
mod kills;
mod live;
pub mod path;
mod ports;
mod session;
#[cfg(test)]
mod tests;
mod tracking;

use crate::children::{instance_in, refuse_second};
use crate::cli;
use crate::process::may_lack_realtime;
use crate::programs::ROS2;
use config::{DriverKind, Loaded, Settings};
use console::{Console, now_text};
use live::Live;
use ports::{Facts, Person, Stop};
use rt::{Exit, Failure, Shutdown};
use serde_json::Value;
use session::{Ended, Session};
use std::fs::{File, OpenOptions};
use std::io::IsTerminal;
use std::path::{Path, PathBuf};

/// The text about what no step can show.
const NOT_SHOWN: &str = include_str!("not_shown.txt").trim_ascii_end();

/// Share of the largest measured age by which `driver.measured_age_max_ms` is proposed. Assumption: two measurements may
/// be lost in a row before the robot counts as silent.
const AGES: f64 = 2.0;

fn is_ros2(settings: &Settings) -> bool {
    Path::new(&settings.driver.program).file_name().is_some_and(|name| name == ROS2.name())
}

pub fn run(options: &cli::Commission) -> Result<Exit, Failure> {
    let place = &options.place;
    let shutdown = Shutdown::on_signals().map_err(Failure::with(Exit::Software))?;
    let loaded = place.load()?;
    if loaded.settings.driver.kind == DriverKind::Robot && !std::io::stdin().is_terminal() {
        let text = format!(
            "{}: driver.kind = \"robot\": commission asks the person beside the robot, but its input is no terminal. Run \
             it at a terminal from which you see the robot",
            place.config.display()
        );
        return Err(Failure::new(Exit::Usage, text));
    }
    refuse_blind(&loaded.settings, &place.config)?;
    let instance = instance_in(&place.run_dir)?;
    refuse_second(&instance)?;
    let (path, log) = open_log(options.log.as_deref())?;
    let console = Console::open(log, shutdown.clone());
    let mut console = console.map_err(Failure::with(Exit::OsErr))?;
    introduce(&mut console, &loaded, place, &path);
    let facts = Facts::from_settings(&loaded, may_lack_realtime(&loaded.settings));
    let mut live = Live::new(&loaded, place, instance, shutdown)?;
    let mut session = Session { robot: &mut live, person: &mut console, facts: &facts, proposals: Vec::new() };
    let outcome = session.run();
    let mut proposals = session.proposals;
    let (trouble, report) = live.end();
    proposals.extend(report.and_then(|report| age(&report)));
    let exit = finish(&mut console, outcome, &trouble, &proposals);
    console.sync().map_err(|error| Failure::unwritable(&path, &error))?;
    exit
}

/// Refuses a robot on DDS that publishes no emergency stop, or that goes on with a weight after a kill of its driver.
fn refuse_blind(settings: &Settings, config: &Path) -> Result<(), Failure> {
    let why = if settings.ros2.setpoints == robot::SetpointKind::ArmSdk {
        "ros2.setpoints = \"arm_sdk\": a killed driver leaves the arms held, and its restart would not"
    } else if is_ros2(settings) && settings.ros2.emergency_stop_topic.is_empty() {
        "ros2.emergency_stop_topic = \"\": commission cannot see whether the emergency stop works"
    } else {
        return Ok(());
    };
    let text = format!("{}: {why}. Make its checks by hand: SAFETY.md, \"Before it moves hardware\"", config.display());
    Err(Failure::new(Exit::Config, text))
}

/// Opens the log. It never replaces a file.
fn open_log(chosen: Option<&Path>) -> Result<(PathBuf, File), Failure> {
    let now = now_text();
    let named = || PathBuf::from(format!("commission-{}.log", now.replace(':', "").split('.').next().unwrap_or(&now)));
    let path = chosen.map_or_else(named, Path::to_path_buf);
    let log = OpenOptions::new().write(true).create_new(true).open(&path);
    log.map(|log| (path.clone(), log)).map_err(|error| Failure::unwritable(&path, &error))
}

fn introduce(console: &mut Console, loaded: &Loaded, place: &cli::InstanceArgs, log: &Path) {
    let kind = if loaded.settings.driver.kind == DriverKind::Robot { "robot" } else { "simulated robot" };
    console.print(&format!(
        "Commissioning the {kind} {} by {} (hash {:016x}). The log is {}.\nStand beside the robot, with its emergency stop \
         in reach. Nobody else is near it. A step that fails or is refused ends the run.",
        loaded.model.name,
        place.config.display(),
        loaded.hash,
        log.display()
    ));
}

fn age(report: &Value) -> Option<String> {
    let oldest_ms = report["oldest_measured_ms"].as_f64()?;
    let proposed_ms = (AGES * oldest_ms).ceil().clamp(1.0, 100.0);
    Some(format!(
        "[driver]\nmeasured_age_max_ms = {proposed_ms:.1}  # the oldest measurement was {oldest_ms:.1} ms old"
    ))
}

fn finish(
    console: &mut Console,
    outcome: Result<Vec<String>, Ended>,
    trouble: &[String],
    proposals: &[String],
) -> Result<Exit, Failure> {
    trouble.iter().for_each(|line| console.print(&format!("At the end: {line}")));
    let Ended { step, why } = match outcome {
        Ok(summary) => {
            console.print("\nSummary");
            summary.iter().for_each(|line| console.print(line));
            if !proposals.is_empty() {
                console.print("\nProposed settings");
                proposals.iter().for_each(|lines| console.print(lines));
            }
            console.print(&format!("\n{NOT_SHOWN}"));
            if trouble.is_empty() {
                return Ok(Exit::Ok);
            }
            let why = Stop::Failed(trouble.join("; "));
            Ended { step: "the end".into(), why }
        }
        Err(ended) => ended,
    };
    let (exit, text) = match why {
        Stop::Failed(why) => (Exit::Failed, format!("failed at {step}: {why}")),
        Stop::Refused(why) => (Exit::Failed, format!("ended at {step}: {why}")),
        Stop::Interrupted if trouble.is_empty() => {
            (Exit::Interrupted, format!("interrupted at {step}; the robot was stopped"))
        }
        Stop::Interrupted => {
            (Exit::Interrupted, format!("interrupted at {step}; the robot may not be at rest, see above"))
        }
    };
    console.log(&text);
    Err(Failure::new(exit, text))
}
