//! The command line.

use clap::builder::{PossibleValuesParser, TypedValueParser};
use clap::{Args, Parser, Subcommand};
use pipeline::{Overrides, RobotInterface};
use std::path::PathBuf;

/// Real-time teleoperation: move a robot's arms by moving your own.
#[derive(Debug, Parser)]
#[command(name = "teleopd", version)]
pub struct Cli {
    #[command(subcommand)]
    pub command: Command,
}

/// Where an instance finds its settings and keeps its sockets and shared memory.
#[derive(Args, Clone, Debug)]
pub struct InstanceArgs {
    /// Settings of this instance. A program installed in /usr/bin defaults to /etc/teleop/teleop.toml if that exists.
    #[arg(long, value_name = "FILE", default_value_os_t = pipeline::default_config())]
    pub config: PathBuf,
    /// Folder of the instance's socket, shared-memory registry and reports; two instances need two. A program installed in
    /// /usr/bin defaults to /run/teleop if that exists.
    #[arg(long, value_name = "DIR", default_value_os_t = pipeline::default_run_dir())]
    pub run_dir: PathBuf,
    /// Engage although the kernel grants no real-time scheduling; simulated driver only.
    #[arg(long)]
    pub engage_without_realtime: bool,
    /// How the simulated robot takes commands, in place of sim.interface: direct, or jtc100, four controllers that are not
    /// synchronised and take points at 100 Hz.
    #[arg(long, value_name = "NAME", value_parser = interface_parser())]
    pub interface: Option<RobotInterface>,
}

fn interface_parser() -> impl TypedValueParser<Value = RobotInterface> {
    let find = |name: String| RobotInterface::ALL.into_iter().find(|interface| interface.name() == name);
    PossibleValuesParser::new(RobotInterface::ALL.map(RobotInterface::name))
        .try_map(move |name| find(name).ok_or("no such interface"))
}

impl InstanceArgs {
    /// What the command line changes of the settings.
    pub fn overrides(&self) -> Overrides {
        Overrides { engage_without_realtime: self.engage_without_realtime, interface: self.interface }
    }
}

/// One of the processes of an instance.
#[derive(Args, Clone, Debug)]
pub struct Process {
    #[command(flatten)]
    pub place: InstanceArgs,
    /// Log warnings and errors alone.
    #[arg(long)]
    pub quiet: bool,
}

#[derive(Debug, Subcommand)]
pub enum Command {
    /// Takes skeletons from clients, validates them, and publishes the one that holds authority.
    Ingest(Process),
    /// Turns skeletons into joint targets at 1500 Hz.
    Retarget(Process),
    /// Whole-body control and the safety gate; owns the operator socket.
    Control(Process),
    /// The driver of the simulated robot.
    Sim(Process),
    /// The simulated robot's body: joints, motors, encoders and a watchdog of its own.
    Robot(Process),
    /// Starts the processes in order, and stops them with the robot at rest.
    Up(Up),
    /// Starts everything, replays a motion, engages, stops at rest and prints what was measured.
    Demo(Demo),
    /// Leads through a motion of your own, the page, a Python client and a recording, in five minutes: each step is a command that
    /// is shown, run and checked.
    Tour(Tour),
    /// Prints every effective value, where it came from, and the hash of them all.
    Check(InstanceArgs),
    /// Shows a running instance in a browser on this machine: the address, with the token of this run, is printed.
    View(View),
    /// Examines the machine and the instance's place, and says what to do about each finding; changes nothing. Exit code 0: ready
    /// for a robot; 3: fine for the simulator alone; 78: something keeps the daemon from running as configured.
    Doctor(Doctor),
}

#[derive(Args, Clone, Debug)]
pub struct Up {
    #[command(flatten)]
    pub place: InstanceArgs,
    /// Also record the instance to this MCAP file, from a process of its own (the program `record`): every message that it can
    /// see. Refused if the file exists.
    #[arg(long, value_name = "FILE.mcap")]
    pub record: Option<PathBuf>,
    /// Print everything that the processes log, and not only what needs somebody.
    #[arg(short, long)]
    pub verbose: bool,
}

/// What a page is served with.
#[derive(Args, Clone, Debug)]
pub struct Page {
    /// Port of 127.0.0.1; 0 is any free one.
    #[arg(long, value_name = "PORT", default_value_t = view::PORT)]
    pub port: u16,
    /// Draw the robot with your own mesh files (DAE, STL, GLB, OBJ): those that the robot's URDF or look file names, found
    /// below this folder by the end of their paths.
    #[arg(long, value_name = "DIR")]
    pub meshes: Option<PathBuf>,
}

#[derive(Args, Clone, Debug)]
pub struct View {
    #[command(flatten)]
    pub place: InstanceArgs,
    /// Show this recording in place of a running instance (by the program `record`).
    #[arg(value_name = "FILE.mcap")]
    pub recording: Option<PathBuf>,
    #[command(flatten)]
    pub page: Page,
    /// Three key poses whose mixes the page can lead the robot through: names (t-pose, hands-up, ...), FILE.bvh:FRAME or
    /// FILE.bvh@TIME_S, with commas between (default: t-pose, hands-up and box).
    #[arg(long, value_name = "A,B,C", value_delimiter = ',', conflicts_with = "recording")]
    pub key_poses: Option<Vec<String>>,
    /// End, as at a signal, once this process is not its parent any more.
    #[arg(long, value_name = "PID", conflicts_with = "recording")]
    pub child_of: Option<u32>,
}

#[derive(Args, Clone, Debug)]
pub struct Doctor {
    #[command(flatten)]
    pub place: InstanceArgs,
    /// Print {simulator, robot, findings} as JSON: whether the machine is fit for each, and {check, level, found, advice}.
    #[arg(long)]
    pub json: bool,
}

#[derive(Args, Clone, Debug)]
pub struct Tour {
    /// Settings. A program installed in /usr/bin defaults to /etc/teleop/teleop.toml if that exists.
    #[arg(long, value_name = "FILE", default_value_os_t = pipeline::default_config())]
    pub config: PathBuf,
    /// Run all steps without asking.
    #[arg(long)]
    pub yes: bool,
    /// Keep what the steps write here (recording, report, logs, virtual environment), instead of in a temporary folder.
    #[arg(long, value_name = "DIR")]
    pub dir: Option<PathBuf>,
}

#[derive(Args, Clone, Debug)]
pub struct Demo {
    /// Settings. A program installed in /usr/bin defaults to /etc/teleop/teleop.toml if that exists.
    #[arg(long, value_name = "FILE", default_value_os_t = pipeline::default_config())]
    pub config: PathBuf,
    /// A motion file to replay in place of the built-in motion.
    #[arg(long, value_name = "FILE")]
    pub motion: Option<PathBuf>,
    /// Stop after so many seconds of motion (default: the whole motion once).
    #[arg(long, value_name = "N")]
    pub seconds: Option<f64>,
    /// Also record the run to this MCAP file; refused if it exists.
    #[arg(long, value_name = "FILE.mcap")]
    pub record: Option<PathBuf>,
    /// Also show the run in a browser on this machine: the address is printed, and the run begins once a page is open.
    #[arg(long)]
    pub view: bool,
    /// Port of 127.0.0.1 for --view; 0 is any free one.
    #[arg(long, value_name = "PORT", default_value_t = view::PORT, requires = "view")]
    pub view_port: u16,
    /// With --view: draw the robot with your own mesh files (DAE, STL, GLB, OBJ), those that the robot's URDF or look file
    /// names, found below this folder by the end of their paths.
    #[arg(long, value_name = "DIR", requires = "view")]
    pub meshes: Option<PathBuf>,
    /// Write the report as JSON.
    #[arg(long, value_name = "FILE")]
    pub report: Option<PathBuf>,
    /// Keep the run's folder (socket, registry, process reports) here instead of a temporary one.
    #[arg(long, value_name = "DIR")]
    pub run_dir: Option<PathBuf>,
    /// How the simulated robot takes commands, in place of sim.interface: direct, or jtc100, four controllers that are not
    /// synchronised and take points at 100 Hz.
    #[arg(long, value_name = "NAME", value_parser = interface_parser())]
    pub interface: Option<RobotInterface>,
    /// No live line and no figures.
    #[arg(long)]
    pub quiet: bool,
}
