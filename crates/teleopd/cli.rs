//! The command line.

use clap::builder::{PossibleValuesParser, TypedValueParser};
use clap::{Args, Parser, Subcommand};
use config::{Interface, Loaded, Overrides, RobotChoice};
use instance::Instance;
use rt::{Exit, Failure};
use std::path::PathBuf;

/// Real-time teleoperation: move a robot's arms by moving your own.
#[derive(Debug, Parser)]
#[command(name = "teleopd", version)]
pub struct Cli {
    #[command(subcommand)]
    pub command: Command,
}

/// Location of an instance: its settings, sockets and shared memory.
#[derive(Args, Clone, Debug)]
pub struct InstanceArgs {
    /// Settings of this instance. A program installed in /usr/bin defaults to /etc/teleop/teleop.toml if that exists.
    #[arg(long, value_name = "FILE", default_value_os_t = instance::default_config())]
    pub config: PathBuf,
    /// Folder for the instance's socket, shared-memory registry and reports. Two instances need two folders. A
    /// program installed in /usr/bin defaults to /run/teleop if that exists.
    #[arg(long, value_name = "DIR", default_value_os_t = instance::default_run_dir())]
    pub run_dir: PathBuf,
    /// Engage even if the kernel grants no real-time scheduling. Simulated driver only.
    #[arg(long)]
    pub engage_without_realtime: bool,
    /// Another robot than that of the settings. NAME has its robot file and its weights in the same folders as the
    /// settings' own. A value with a slash or .toml is a file.
    #[arg(long, value_name = "NAME|FILE")]
    pub robot: Option<RobotChoice>,
    /// How the robot interpolates between setpoints, overrides driver.interface. direct: takes every setpoint. jtc100:
    /// four unsynchronised controllers that take points at 100 Hz. jtc100-restart: they begin again at each point.
    #[arg(long, value_name = "NAME", value_parser = named(Interface::ALL, Interface::NAMES))]
    pub interface: Option<Interface>,
}

/// Takes one of `values` by its name, which is at the same place in `names`.
fn named<T: Copy + Send + Sync + 'static, const N: usize>(
    values: [T; N],
    names: [&'static str; N],
) -> impl TypedValueParser<Value = T> {
    let find = move |name: String| names.iter().position(|known| *known == name).map(|index| values[index]);
    PossibleValuesParser::new(names).try_map(move |name| find(name).ok_or("unknown name"))
}

impl InstanceArgs {
    /// Reads the settings with every file that they name.
    pub fn load(&self) -> Result<Loaded, Failure> {
        config::load(&self.config, self.overrides()).map_err(Failure::with(Exit::Config))
    }

    /// Gives these arguments to another process of `instance`.
    pub fn hand_on(&self, command: &mut std::process::Command, instance: &Instance) {
        command.arg("--config").arg(&self.config).arg("--run-dir").arg(instance.run_dir());
        if self.engage_without_realtime {
            command.arg("--engage-without-realtime");
        }
        if let Some(interface) = self.interface {
            command.arg("--interface").arg(interface.name());
        }
        if let Some(robot) = &self.robot {
            command.arg("--robot").arg(robot.typed());
        }
    }

    /// Returns the settings that the command line overrides.
    pub fn overrides(&self) -> Overrides {
        let (interface, robot) = (self.interface, self.robot.clone());
        Overrides { engage_without_realtime: self.engage_without_realtime, interface, robot }
    }
}

/// One of the processes of an instance.
#[derive(Args, Clone, Debug)]
pub struct Process {
    #[command(flatten)]
    pub place: InstanceArgs,
    /// Log only warnings and errors.
    #[arg(long)]
    pub quiet: bool,
}

#[derive(Debug, Subcommand)]
pub enum Command {
    /// Takes skeletons from clients, validates them, and publishes those of the client that holds the lease.
    Ingest(Process),
    /// Turns skeletons into joint targets at 1500 Hz.
    Retarget(Process),
    /// Runs whole-body control and the safety gate. Owns the operator socket.
    Control(Process),
    /// Drives the robot: runs the program that `driver.program` names, or else the driver of the simulated robot.
    Driver(Process),
    /// Simulates the robot: joints, motors, encoders and its own watchdog. With `new`: writes a robot file.
    #[command(args_conflicts_with_subcommands = true)]
    Robot {
        #[command(flatten)]
        process: Process,
        #[command(subcommand)]
        file: Option<RobotFile>,
    },
    /// Starts the processes in order. Stops them with the robot at rest.
    Up(Up),
    /// Starts everything, replays a motion, engages, stops at rest and prints the measurements.
    Demo(Demo),
    /// Checks a robot that speaks ROS 2 before it is driven. Sends nothing. Exits with 1 if a check failed.
    Preflight(Preflight),
    /// The first hour with a robot: preflight, emergency stop, each joint alone, kill -9 of every process, delay. Asks
    /// before each step, judges it by measurement, and writes a log. Exits with 1 at the first step that fails or is
    /// refused.
    Commission(Commission),
    /// Publishes joint targets in place of `retarget`, as `commission` writes them to the standard input.
    #[command(hide = true)]
    Targets(Process),
    /// Prints every effective value, its source, and the hash of all values.
    Check(InstanceArgs),
    /// Makes a pose landmarker of the networks that `npm ci --prefix tools/camera` installed, for `teleopd-camera`. Prints
    /// its path.
    Landmarker {
        /// The landmarker.
        #[arg(value_parser = named(view::Landmarker::ALL, view::Landmarker::NAMES))]
        landmarker: view::Landmarker,
        /// Folder in which npm installed it.
        #[arg(long, value_name = "DIR", default_value = "tools/camera/node_modules")]
        modules: PathBuf,
    },
    /// Shows a running instance in a browser on this machine. Prints the address with this run's token.
    View(View),
    /// Examines the machine and the instance's folders, and advises on each finding. With --robot also prints a page
    /// about the robot: joints, stop times, torque, clearance, reach. Changes nothing. Exit code 0: ready for a robot.
    /// 3: fine for the simulator only. 78: the daemon cannot run as configured.
    Doctor(Doctor),
}

/// Commands on robot files.
#[derive(Debug, Subcommand)]
pub enum RobotFile {
    /// Writes a first robot file for a URDF: arms, T-pose, home, limits. Says what it guessed and what you must decide.
    New {
        /// The URDF, or a xacro that xacrodoc or xacro can expand. The robot file must stay in the URDF's folder.
        #[arg(value_name = "FILE.urdf or FILE.xacro")]
        urdf: PathBuf,
        /// An argument of the xacro. Repeat it for several.
        #[arg(long, value_name = "NAME:=VALUE")]
        xacro: Vec<String>,
        /// Write the robot file here (default: beside the URDF). Fails if the file exists.
        #[arg(long, value_name = "FILE.toml")]
        out: Option<PathBuf>,
    },
}

#[derive(Args, Clone, Debug)]
pub struct Up {
    #[command(flatten)]
    pub place: InstanceArgs,
    /// Also record all visible messages of the instance to this MCAP file. A separate process, `record`, does
    /// this. Fails if the file exists.
    #[arg(long, value_name = "FILE.mcap")]
    pub record: Option<PathBuf>,
    /// Print all log lines of the processes, not only warnings and errors.
    #[arg(short, long)]
    pub verbose: bool,
}

/// Options of `commission`. No option skips a step or answers a question.
#[derive(Args, Clone, Debug)]
pub struct Commission {
    #[command(flatten)]
    pub place: InstanceArgs,
    /// Write the log to this file. Default: commission-DATE.log in the present folder. Fails if the file exists.
    #[arg(long, value_name = "FILE")]
    pub log: Option<PathBuf>,
}

/// Options of `preflight`, here and in the program that speaks ROS 2.
#[derive(Args, Clone, Debug)]
pub struct Preflight {
    /// Settings that name the robot and its domain.
    #[arg(long, value_name = "FILE", default_value_os_t = instance::default_config())]
    pub config: PathBuf,
    /// Another robot than that of the settings: its name, or its robot file.
    #[arg(long, value_name = "NAME|FILE")]
    pub robot: Option<RobotChoice>,
    /// Also print the messages that would be sent to the robot as it stands.
    #[arg(long)]
    pub dry_run: bool,
}

/// Options of the page.
#[derive(Args, Clone, Debug)]
pub struct Page {
    /// Port on 127.0.0.1, or at the address of --https. 0 picks any free port.
    #[arg(long, value_name = "PORT", default_value_t = view::PORT)]
    pub port: u16,
    /// Draw the robot with your own mesh files (DAE, STL, GLB, OBJ). Searches below this folder for the files
    /// that the robot's URDF or look file names. Files match by the end of their path.
    #[arg(long, value_name = "DIR")]
    pub meshes: Option<PathBuf>,
}

#[derive(Args, Clone, Debug)]
pub struct View {
    #[command(flatten)]
    pub place: InstanceArgs,
    /// Show this recording instead of a running instance (starts the program `record`).
    #[arg(value_name = "FILE.mcap")]
    pub recording: Option<PathBuf>,
    #[command(flatten)]
    pub page: Page,
    /// Three key poses, separated by commas. The page can lead the robot through mixes of them. Each is a name
    /// (t-pose, hands-up, ...), FILE.bvh:FRAME or FILE.bvh@TIME_S (default: t-pose, hands-up and box).
    #[arg(long, value_name = "A,B,C", value_delimiter = ',', conflicts_with = "recording")]
    pub key_poses: Option<Vec<String>>,
    /// Lets the page use your webcam. MODEL is the pose landmarker of MediaPipe: full (the default), the quicker lite, or a
    /// .task file of yours.
    #[arg(long, value_name = "MODEL", num_args = 0..=1, default_missing_value = "full", conflicts_with = "recording")]
    pub camera: Option<PathBuf>,
    /// Folder of the library that finds a person in an image (default: where `npm ci --prefix tools/camera` puts it).
    #[arg(long, value_name = "DIR", requires = "camera", default_value = view::VISION_FOLDER, hide_default_value = true)]
    pub vision: PathBuf,
    /// Shows the page to other machines by TLS, for a headset. The first value is the address of this machine to listen at.
    /// Further ones are names by which it is reached, as in 192.168.1.7,robot.local.
    #[arg(long, value_name = "ADDRESS", value_delimiter = ',', conflicts_with = "recording")]
    pub https: Option<Vec<String>>,
    /// Folder of the certificate, which is made at the first start (default: tls in the run directory).
    #[arg(long, value_name = "DIR", requires = "https")]
    pub tls: Option<PathBuf>,
    /// Exit as on a signal once this process is no longer the parent.
    #[arg(long, value_name = "PID", conflicts_with = "recording")]
    pub child_of: Option<u32>,
}

#[derive(Args, Clone, Debug)]
pub struct Doctor {
    #[command(flatten)]
    pub place: InstanceArgs,
    /// Print {simulator, robot, findings} as JSON. The first two say if the machine is fit for each. Each finding
    /// is {check, level, found, advice}.
    #[arg(long)]
    pub json: bool,
    /// Also judge the robot's capsules against the meshes in this folder (runs the program `collision`).
    #[arg(long, value_name = "DIR", conflicts_with = "json")]
    pub meshes: Option<PathBuf>,
    /// The URDF that names the meshes (default: the robot's own).
    #[arg(long, value_name = "FILE.urdf", requires = "meshes")]
    pub urdf: Vec<PathBuf>,
}

#[derive(Args, Clone, Debug)]
pub struct Demo {
    /// Settings. A program installed in /usr/bin defaults to /etc/teleop/teleop.toml if that exists.
    #[arg(long, value_name = "FILE", default_value_os_t = instance::default_config())]
    pub config: PathBuf,
    /// Another robot than that of the settings. NAME has its robot file and its weights in the same folders as the
    /// settings' own. A value with a slash or .toml is a file.
    #[arg(long, value_name = "NAME|FILE")]
    pub robot: Option<RobotChoice>,
    /// Motion file to replay instead of the built-in motion, or `pick-and-place`.
    #[arg(long, value_name = "FILE")]
    pub motion: Option<PathBuf>,
    #[command(flatten)]
    pub load: motion::LoadOptions,
    /// Stop after this many seconds of motion (default: the whole motion once).
    #[arg(long, value_name = "N", value_parser = rt::number, allow_negative_numbers = true)]
    pub seconds: Option<f64>,
    /// Also record the run to this MCAP file. Fails if the file exists.
    #[arg(long, value_name = "FILE.mcap")]
    pub record: Option<PathBuf>,
    /// Also show the run in a browser on this machine. Prints the address. The run begins once a page is open.
    #[arg(long)]
    pub view: bool,
    /// Port on 127.0.0.1 for --view. 0 picks any free port.
    #[arg(long, value_name = "PORT", default_value_t = view::PORT, requires = "view")]
    pub view_port: u16,
    /// With --view: draw the robot with your own mesh files (DAE, STL, GLB, OBJ). Searches below this folder for
    /// the files that the robot's URDF or look file names. Files match by the end of their path.
    #[arg(long, value_name = "DIR", requires = "view")]
    pub meshes: Option<PathBuf>,
    /// Write the report as JSON.
    #[arg(long, value_name = "FILE")]
    pub report: Option<PathBuf>,
    /// Keep the run's folder here: socket, registry, process reports. Default: a temporary folder.
    #[arg(long, value_name = "DIR")]
    pub run_dir: Option<PathBuf>,
    /// How the robot interpolates between setpoints, overrides driver.interface. direct: takes every setpoint. jtc100:
    /// four unsynchronised controllers that take points at 100 Hz. jtc100-restart: they begin again at each point.
    #[arg(long, value_name = "NAME", value_parser = named(Interface::ALL, Interface::NAMES))]
    pub interface: Option<Interface>,
    /// Print no live picture: only what starts, and the table at the end.
    #[arg(long)]
    pub quiet: bool,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn handed_on_options_give_the_children_the_same_settings() {
        let folder = tempfile::tempdir().expect("a folder");
        let instance = Instance::new(folder.path()).expect("an instance");
        for options in
            ["", "--robot unitree_g1", "--robot mine/robot.toml --interface jtc100 --engage-without-realtime"]
        {
            let up = ["teleopd", "up"].into_iter().chain(options.split_whitespace());
            let Command::Up(up) = Cli::parse_from(up).command else { panic!("up") };
            let mut child = std::process::Command::new("teleopd");
            child.arg("control");
            up.place.hand_on(&mut child, &instance);
            let words = [child.get_program()].into_iter().chain(child.get_args());
            let Command::Control(control) = Cli::parse_from(words).command else { panic!("control") };
            assert_eq!(control.place.overrides(), up.place.overrides(), "{options}");
            assert_eq!(control.place.overrides().robot.is_some(), options.contains("--robot"), "{options}");
        }
    }
}
