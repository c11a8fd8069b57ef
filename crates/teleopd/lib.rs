//! The processes of teleopd and the commands that manage them. This is a library, so that a harness can start the
//! same processes from its own executable: `Children` starts the running executable again. The binary `teleopd`
//! only calls `main`.

mod check;
mod children;
mod cli;
mod commission;
mod demo;
mod doctor;
mod figure;
mod figures;
mod folder;
mod live_display;
mod process;
mod processes;
mod programs;
mod recorder;
mod report;
mod robot_file;
mod starter;
mod timeline;
mod up;
mod view;

use clap::Parser;
use cli::{Cli, Command};
use rt::{Exit, Failure, finish};
use std::process::ExitCode;

pub use children::{Children, Output};
pub use cli::{InstanceArgs, Preflight};
pub use process::realtime::placement;
pub use processes::{PROCESSES, Row, TABLE};
pub use recorder::Recorder;
pub use report::{Report, Simulator};

/// Runs the command from the command line. The exit code is one of `rt::Exit`.
pub fn main() -> ExitCode {
    rt::abort_on_panic();
    // Set before any thread starts, so that the stages compute the same here as in every tool. The processes
    // report the outcome.
    let _ = rt::flush_denormals();
    let outcome = match Cli::parse().command {
        Command::Ingest(one) => process(&one, process::ingest::run),
        Command::Retarget(one) => process(&one, process::retarget::run),
        Command::Control(one) => process(&one, process::control::run),
        Command::Robot { process: one, file: None } => process(&one, process::robot::run),
        Command::Robot { file: Some(file), .. } => robot_file::run(&file),
        Command::Driver(one) => process(&one, process::remote::run),
        Command::Up(options) => up::run(&options),
        Command::Demo(options) => demo::run(&options),
        Command::Preflight(options) => preflight(&options),
        Command::Commission(options) => commission::run(&options),
        Command::Targets(one) => process(&one, process::targets::run),
        Command::Check(place) => check::run(&place),
        Command::View(options) => view::run(&options),
        Command::Doctor(options) => doctor::run(&options),
        Command::Landmarker { landmarker, modules } => view::landmarker(landmarker, &modules),
    };
    finish("teleopd", outcome)
}

/// The command line of a driver's program: that of `teleopd driver`.
#[derive(Debug, Parser)]
struct DriverCli {
    #[command(flatten)]
    process: cli::Process,
}

/// The main function of a driver's own program. It reads the command line and the settings, opens the robot, and drives it
/// until a signal ends it and the robot is at rest. `interface` declares how the robot interpolates between setpoints. The
/// program ends if `driver.interface` of the settings is another one. `open` connects to the robot of this model. Its error
/// ends the program.
///
/// The robot must answer [`driver::Driver::read`] from the moment it is open. The exit code is one of [`rt::Exit`].
pub fn drive<D: driver::Driver>(
    interface: driver::Interface,
    open: impl Fn(&robot::Model) -> Result<D, String>,
) -> ExitCode {
    drive_configured(interface, |loaded, _| open(&loaded.model))
}

/// As [`drive`], for a driver that has settings of its own, and threads. They belong on the given cores, beside the loop.
/// None: any will do.
pub fn drive_configured<D: driver::Driver>(
    interface: driver::Interface,
    open: impl Fn(&config::Loaded, Option<&[usize]>) -> Result<D, String>,
) -> ExitCode {
    rt::abort_on_panic();
    let _ = rt::flush_denormals();
    let open = |process: &process::Process, _: &bus::Domain| {
        open(&process.loaded, process.others.as_deref()).map_err(|cause| Failure::new(Exit::Unavailable, cause))
    };
    finish("teleopd", process(&DriverCli::parse().process, |place| process::driver::run(place, Some(interface), open)))
}

/// Becomes the program that speaks ROS 2. Nothing else here is linked with DDS.
fn preflight(options: &cli::Preflight) -> Result<Exit, Failure> {
    let program = programs::ROS2.path()?;
    let mut command = std::process::Command::new(&program);
    command.arg("preflight").arg("--config").arg(&options.config);
    if let Some(robot) = &options.robot {
        command.arg("--robot").arg(robot.typed());
    }
    command.args(options.dry_run.then_some("--dry-run"));
    let cause = std::os::unix::process::CommandExt::exec(&mut command);
    Err(Failure::new(Exit::OsErr, format!("{} cannot be started: {cause}", program.display())))
}

fn process(one: &cli::Process, run: impl Fn(&InstanceArgs) -> Result<(), Failure>) -> Result<Exit, Failure> {
    let level = if one.quiet { telemetry::LevelFilter::WARN } else { telemetry::LevelFilter::INFO };
    telemetry::install_logging(level);
    run(&one.place).map(|()| Exit::Ok)
}
