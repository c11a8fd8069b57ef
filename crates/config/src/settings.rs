//! `teleop.toml`: its structure and its bounds. Every key is required, and an unknown key is refused.

use crate::ConfigError;
use crate::cores::{Chooser, Cores};
use driver::Interface;
use ingest::Filter;
use schema::{Key, OutOfBounds, Table};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// All settings of one instance, as written in the file.
#[derive(Clone, Debug, Default, Deserialize, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
#[allow(missing_docs, reason = "the names say it")]
pub struct Settings {
    pub robot: RobotFile,
    pub environment: robot::Environment,
    pub weights: WeightsFile,
    pub retarget: retarget::Settings,
    pub doors: DoorSettings,
    pub ingest: IngestSettings,
    pub control: ControlSettings,
    pub driver: DriverSettings,
    pub safety: safety::engage::Settings,
    pub realtime: RealtimeSettings,
    pub metrics: MetricsSettings,
    pub sim: SimSettings,
    pub ros2: Ros2Settings,
}

schema::table! {
    /// The robot.
    pub struct RobotFile {
        /// Robot file, relative to the settings file.
        file: String = "robots/tiago_dual.toml".to_owned();
    }
}

schema::table! {
    /// The trained weights.
    pub struct WeightsFile {
        /// Trained weights, as a path without extension, relative to the settings file. It names `FILE.safetensors` and
        /// `FILE.toml`.
        file: String = "../weights/tiago_dual".to_owned();
    }
}

schema::table! {
    /// Each socket belongs to a group. With an empty name, it belongs to the group of the daemon's process.
    pub struct DoorSettings {
        /// Group whose members may publish skeletons, and chunks of a policy, through `skeleton.sock`. `""` is the group of the daemon's process.
        skeleton_group: String = String::new();
        /// Group whose members may command through `operator.sock`. `""` is the group of the daemon's process.
        operator_group: String = String::new();
    }
}

schema::table! {
    /// `ingest` receives persons from clients. These keys set the layouts, the lease and the filter.
    pub struct IngestSettings {
        /// Silence after which a client's lease ends, ms. It is at least the sum of `safety.input_stale_ms` and the
        /// longest stop (500 ms), so the lease never passes on while the robot still moves.
        authority_timeout_ms: f64 = 1000.0, in [100.0, 60_000.0];
        /// Files of skeleton layouts beside the built-in ones, relative to the settings file. At most 16. An example is
        /// `["skeletons/zed_body_38.toml"]`.
        layouts: Vec<String> = Vec::new();
        /// Folder of the files that `teleopctl calibrate` writes, relative to the settings file.
        operators: String = "operators".to_owned();
        /// The robot moves as the person's image in a mirror. Its left arm follows the person's right one. Set it
        /// if the person faces the robot.
        mirror: bool = false;
        /// Network that finds the directions of arms and trunk in the points of an image, as a path without extension,
        /// relative to the settings file. It names `FILE.safetensors` and `FILE.toml`. With `""` there is none, and the
        /// landmarker's own depth counts.
        lifter: String = "../weights/lifter".to_owned();
        /// Layouts whose positions are filtered. `"cameras"` filters those that a camera sees, `"all"` filters every one,
        /// `"none"` filters none.
        filter: Filter = Filter::Cameras;
        /// Cut-off of the One-Euro filter at rest, Hz. It delays a joint at rest by 1 / (2 pi cut-off), which
        /// is 106 ms at 1.5 Hz. Assumption.
        filter_rest_cutoff_hz: f64 = 1.5, in [0.5, 100.0];
        /// Growth of the cut-off with the joint's speed, Hz per m/s. With the shipped values the delay is 1 / (2
        /// pi (1.5 + 10 v) Hz) at v m/s, which is 14 ms at 1 m/s. Assumption.
        filter_cutoff_per_m: f64 = 10.0, in [0.0, 1000.0];
        /// Threshold of the Hampel filter, in scaled median deviations of the joint's last 7 frames. A joint is an
        /// outlier if it comes further than that from where it could have gone, and further than 1.8 m/s times the period
        /// (6 cm at 30 Hz). An outlier is held for one frame. A second one in a row counts as motion. The filter delays by
        /// one frame where it holds, and by none elsewhere. 0 holds none.
        filter_outliers_mad: f64 = 3.0, in [0.0, 20.0];
    }
}

/// Users who may reset an emergency stop that an operator pressed.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Serialize, Eq)]
#[serde(rename_all = "kebab-case")]
pub enum EmergencyStopReset {
    /// Every operator.
    Anyone,
    /// The user who pressed it, or root.
    Presser,
}

schema::table! {
    /// `control` commands the robot. These keys set its timing, and the conditions to engage and reset.
    pub struct ControlSettings {
        /// How long after its deadline tick k runs without a target, us.
        grace_us: f64 = 150.0, in [0.0, 600.0];
        /// Lets a machine without real-time scheduling engage. It counts with a simulated driver only.
        engage_without_realtime: bool = false;
        /// Operators that may reset an emergency stop of an operator. `"anyone"` allows every operator. `"presser"` requires a
        /// reset by every user who pressed it, or by root. docs/src/operating.md says more.
        emergency_stop_reset: EmergencyStopReset = EmergencyStopReset::Anyone;
        /// A Disengaged robot opens its grippers. Otherwise they hold what they hold, as in every stop.
        open_grippers_when_disengaged: bool = false;
    }
}

/// Robot that the driver talks to.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Serialize, Eq)]
#[serde(rename_all = "kebab-case")]
pub enum DriverKind {
    /// A simulated robot.
    Sim,
    /// A robot. Nothing is relaxed for it.
    Robot,
}

schema::table! {
    /// The robot that the driver talks to, and its timing.
    pub struct DriverSettings {
        /// Robot that the driver talks to. `"sim"` is a simulated one, `"robot"` a real one. A real one needs `program`, and
        /// nothing is relaxed for it.
        kind: DriverKind = DriverKind::Sim;
        /// Program that drives the robot, started in place of the driver of the built-in simulator. Empty for the built-in
        /// one. A path with a slash is relative to this file. `"teleopd-ros2"` drives a robot that speaks ROS 2.
        program: String = String::new();
        /// How the robot interpolates between setpoints. Whole-body control certifies that motion. `"direct"` takes every
        /// setpoint at its index. `"jtc100"` has trajectory controllers, not synchronised, that take points at 100 Hz. A
        /// simulated robot has `"direct"` if this key is missing. With `kind = "robot"` the key is required, and the program
        /// must declare the same. `"jtc100-restart"` is for a simulated robot only: its controllers begin again at the measured
        /// position with each point, in a step.
        interface: Option<Interface> = None;
        /// Age of a measurement beyond which the robot counts as silent, ms. It is ten periods of a port of 1 kHz. Joint
        /// states of ROS 2 at 50 Hz need 60.
        measured_age_max_ms: f64 = 10.0, in [1.0, 100.0];
        /// How long after its deadline command k is due, us. It is at least `control.grace_us`.
        grace_us: f64 = 450.0, in [0.0, GRACE_MAX_US];
        /// Silence of `control` that latches the driver's fault, ms. At least one tick. The stop plan plays from the
        /// first missed tick.
        silence_latch_ms: f64 = 10.0, in [messages::TICK_S * 1e3, 10.0];
    }
}

/// Scheduling policy of the loops.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Serialize, Eq)]
#[serde(rename_all = "kebab-case")]
pub enum Policy {
    /// SCHED_FIFO.
    Fifo,
    /// SCHED_OTHER.
    Other,
}

/// How the next process learns of a new message.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Serialize, Eq)]
#[serde(rename_all = "kebab-case")]
pub enum HandOff {
    /// The writer wakes it.
    Events,
    /// It polls once a period.
    Polled,
}

schema::table! {
    /// Prometheus text on the loopback interface.
    pub struct MetricsSettings {
        /// Port of the Prometheus text on 127.0.0.1. `ingest` has this port, and retarget, control, driver and
        /// robot have the next four. 0 serves none.
        port: u32 = 0, in [0.0, 65_531.0];
    }
}

schema::table! {
    /// Settings of scheduling, cores and memory.
    pub struct RealtimeSettings {
        /// Scheduling policy of the loops, `"fifo"` or `"other"`.
        policy: Policy = Policy::Fifo;
        /// How the next process learns of a message. With `"events"` the writer wakes it. With `"polled"` each process
        /// looks once a period, which is slower and is there to compare.
        hand_off: HandOff = HandOff::Events;
        /// Locks the processes' memory, so that no page fault waits for a disk.
        lock_memory: bool = true;
        /// Real-time priority of retarget.
        priority_retarget: u32 = 70, in [1.0, 98.0];
        /// Real-time priority of control.
        priority_control: u32 = 75, in [1.0, 98.0];
        /// Real-time priority of the driver.
        priority_driver: u32 = 80, in [1.0, 98.0];
        /// Cores of retarget, control and driver. A list such as `[2, 3]` names 1 to 1024 cores, each 0 to 1023. `"free"`
        /// leaves them to the kernel. `"auto"` takes the first isolated core, or the last of 2 to 4, or none.
        cores: Cores = Cores::Chosen(Chooser::Auto);
        /// How long before each tick retarget watches the clock, us. It wakes closer to the tick and keeps a core
        /// busy meanwhile. 100 costs 15 % of a core.
        spin_us: f64 = 0.0, in [0.0, 200.0];
        /// Keeps every core awake while the daemon runs. It wakes sooner and uses more power.
        cpu_dma_latency: bool = true;
    }
}

schema::table! {
    /// A robot that speaks ROS 2, for the program `teleopd-ros2`.
    pub struct Ros2Settings {
        /// DDS domain of the robot (its ROS_DOMAIN_ID).
        domain_id: u32 = 0, in [0.0, 232.0];
        /// Network interface, for example `"eth0"`. Empty for all.
        interface: String = String::new();
        /// Setpoints that `teleopd-ros2` sends. `"trajectories"` are for trajectory controllers, which play the certified
        /// stop when messages end. With `"positions"` and `"arm_sdk"` nobody stops the robot if the driver dies: it holds the
        /// last position at once, from any speed. It must agree with `[driver]` of the robot file.
        setpoints: robot::SetpointKind = robot::SetpointKind::Trajectories;
        /// Topic of the measured joint positions.
        joint_states_topic: String = "/joint_states".to_owned();
        /// Topic that says whether the robot's emergency stop is pressed. Empty for a robot that has none.
        emergency_stop_topic: String = "/power/is_emergency".to_owned();
        /// Time between a setpoint and its execution by the robot's controllers, ms. It is longer than the way of a
        /// message, the messages that may be lost in a row (5.3 ms each) and the error of the robot's clock together.
        delay_ms: f64 = 25.0, in [12.0, 45.0];
        /// Time by which the robot's servos follow their controllers later, ms. With `setpoints = "positions"` or
        /// `"arm_sdk"` it is the whole time from a message to the motion, and `delay_ms` does not count.
        servo_lag_ms: f64 = 0.0, in [0.0, 100.0];
    }
}

schema::table! {
    /// The simulated robot.
    pub struct SimSettings {
        /// Seed of the encoders' noise and of the delays of jtc100.
        seed: u64 = 1;
        /// Natural frequency of a joint's closed position loop, Hz. Assumption for a geared arm joint.
        natural_frequency_hz: f64 = 15.0, in [1.0, 50.0];
        /// Damping ratio of that loop. Assumption.
        damping_ratio: f64 = 1.0, in [0.1, 1.5];
        /// Factor on the bounds of the tracking error. At all limits at once these soft drives stay 20 mrad
        /// behind, and nobody stands beside a simulated robot.
        tracking_error_factor: f64 = 7.0, in [1.0, 10.0];
        /// Delay between driver and robot, in ticks of 1/1500 s. Assumption of one field-bus cycle of 1 ms, rounded up.
        delay_ticks: u32 = 2, in [0.0, plant::DELAY_MAX_TICKS as f64];
        /// Silence of the driver after which the robot reacts by itself, ms. At most 20 with `reaction = "play"`.
        /// Assumption.
        watchdog_ms: f64 = 10.0, in [1.0, 1000.0];
        /// Reaction of the robot by itself after that. `"play"` plays the certified stop that came with the last setpoint. Behind
        /// jtc100 no stop comes, and the joints brake alone. `"hold"` brakes each joint alone. `"damp"` lets the motors
        /// damp. Real robots differ.
        reaction: plant::Reaction = plant::Reaction::Play;
        /// Standard deviation of the encoders' noise, rad. Assumption of one step of the encoder.
        encoder_noise_rad: f64 = 4.8e-5, in [0.0, plant::ENCODER_NOISE_MAX_RAD];
        /// Step of the encoders, rad. Assumption of 17 bits per turn.
        encoder_step_rad: f64 = 4.8e-5, in [0.0, 0.01];
        /// Mass that the left hand truly carries, kg. Without it the robot file's value counts. `control` learns a
        /// payload only from `teleopctl payload`.
        payload_left_kg: Option<f64> = None, in [0.0, robot::PAYLOAD_MAX_KG];
        /// As `payload_left_kg`, for the right hand, kg.
        payload_right_kg: Option<f64> = None, in [0.0, robot::PAYLOAD_MAX_KG];
        /// Width of an object between the fingers of each gripper, m. They stop there and press. 0 is nothing.
        object_width_m: f64 = 0.0, in [0.0, plant::OBJECT_MAX_M];
    }
}

/// Largest number of layout files. Assumption: more than the systems of one laboratory. All of them are searched
/// for a number.
const LAYOUTS_MAX: usize = 16;

/// Latest deadline of the driver's command, us. One tick is 667 us.
const GRACE_MAX_US: f64 = 660.0;

/// Longest stop of any robot, ms. `limits.stop_time_max_ms` of a robot file may not exceed it.
const STOP_LONGEST_MS: f64 = 500.0;

/// A table of the settings file, as documents show it.
#[derive(Clone, Debug, PartialEq)]
pub struct Reference {
    /// Its name, such as `retarget`.
    pub name: &'static str,
    /// The lines that say what it is.
    pub meaning: &'static [&'static str],
    /// Its keys.
    pub keys: &'static [Key],
    /// The default of each key. A key without a default is missing.
    pub defaults: toml::Table,
}

impl Reference {
    fn for_table<T: Table>(name: &'static str) -> Self {
        let defaults = toml::Table::try_from(T::default()).unwrap_or_default();
        Self { name, meaning: T::MEANING, keys: T::KEYS, defaults }
    }
}

impl Settings {
    /// Returns all tables in the order of the file.
    pub fn reference() -> Vec<Reference> {
        vec![
            Reference::for_table::<RobotFile>("robot"),
            Reference::for_table::<robot::PlaneEntry>("environment.planes"),
            Reference::for_table::<robot::BoxEntry>("environment.boxes"),
            Reference::for_table::<WeightsFile>("weights"),
            Reference::for_table::<retarget::Settings>("retarget"),
            Reference::for_table::<DoorSettings>("doors"),
            Reference::for_table::<IngestSettings>("ingest"),
            Reference::for_table::<ControlSettings>("control"),
            Reference::for_table::<DriverSettings>("driver"),
            Reference::for_table::<safety::engage::Settings>("safety"),
            Reference::for_table::<RealtimeSettings>("realtime"),
            Reference::for_table::<MetricsSettings>("metrics"),
            Reference::for_table::<SimSettings>("sim"),
            Reference::for_table::<Ros2Settings>("ros2"),
        ]
    }

    /// Parses `text` and checks its bounds. Errors name `file`.
    pub fn parse(file: &str, text: &str) -> Result<Self, ConfigError> {
        let settings = Self::parse_unchecked(file, text)?;
        settings.check(file)?;
        Ok(settings)
    }

    /// Parses `text`. Its values are not checked yet, because the command line may replace some of them.
    pub(crate) fn parse_unchecked(file: &str, text: &str) -> Result<Self, ConfigError> {
        let syntax = |cause: String| ConfigError::Syntax { file: file.to_owned(), cause };
        let table: toml::Table = toml::from_str(text).map_err(|error| syntax(error.to_string()))?;
        let moved = moved_keys(&table);
        if !moved.is_empty() {
            return Err(syntax(format!("{}; move each key, with its value", moved.join("; "))));
        }
        toml::from_str(text).map_err(|error| syntax(error.to_string()))
    }

    /// How the robot interpolates between setpoints.
    pub fn interface(&self) -> Interface {
        self.driver.interface.unwrap_or_default()
    }

    /// Refuses an interface other than the one that the driver's program declares for its robot.
    pub fn check_declared(&self, declared: Interface) -> Result<(), String> {
        let configured = self.interface();
        if configured == declared {
            return Ok(());
        }
        Err(format!(
            "driver.interface = \"{}\", must be \"{}\": this driver declares that its robot interpolates so, and whole-body \
             control must certify that motion",
            configured.name(),
            declared.name()
        ))
    }

    /// Factor on the bounds of the tracking error. It is one, except for a simulated robot.
    pub const fn tracking_error_factor(&self) -> f64 {
        match self.driver.kind {
            DriverKind::Sim => self.sim.tracking_error_factor,
            DriverKind::Robot => 1.0,
        }
    }

    /// Returns the program that drives the robot in place of the simulated one. `None` if there is none. A path with a
    /// slash is relative to the settings file `config`. A bare name is searched beside this program, then in PATH.
    pub fn driver_program(&self, config: &Path) -> Option<PathBuf> {
        let program = Path::new(&self.driver.program);
        match program.components().count() {
            0 => None,
            1 if !self.driver.program.contains('/') => {
                let beside = std::env::current_exe().ok().map(|own| own.with_file_name(program));
                Some(beside.filter(|beside| beside.is_file()).unwrap_or_else(|| program.to_owned()))
            }
            _ => Some(config.parent().unwrap_or(Path::new("")).join(program)),
        }
    }

    /// Returns the time by which the joints of a robot on DDS follow their messages, ms. Positions are executed at once, so
    /// `ros2.delay_ms` belongs to trajectories alone.
    pub fn ros2_behind_ms(&self) -> f64 {
        let plays_curves = self.ros2.setpoints == robot::SetpointKind::Trajectories;
        self.ros2.servo_lag_ms + if plays_curves { self.ros2.delay_ms } else { 0.0 }
    }

    /// Returns the known delay of the servos, ticks. None is assumed of a real robot.
    pub const fn servo_delay_ticks(&self) -> u32 {
        match self.driver.kind {
            DriverKind::Sim => self.sim.delay_ticks,
            DriverKind::Robot => 0,
        }
    }

    /// Checks every value, and values that must fit together.
    pub(crate) fn check(&self, file: &str) -> Result<(), ConfigError> {
        let bound = |table: &str, OutOfBounds { key, value, low, high }| {
            let key = format!("{table}.{key}");
            ConfigError::Bound { file: file.to_owned(), key, value, low, high }
        };
        let checked = [
            ("retarget", self.retarget.check()),
            ("ingest", self.ingest.check()),
            ("control", self.control.check()),
            ("driver", self.driver.check()),
            ("realtime", self.realtime.check().and_then(|()| self.realtime.cores.check())),
            ("metrics", self.metrics.check()),
            ("sim", self.sim.check()),
            ("ros2", self.ros2.check()),
        ];
        for (table, checked) in checked {
            checked.map_err(|error| bound(table, error))?;
        }
        self.safety
            .validate()
            .map_err(|error| ConfigError::Syntax { file: file.to_owned(), cause: error.to_string() })?;
        if self.ingest.layouts.len() > LAYOUTS_MAX {
            let (value, most) = (self.ingest.layouts.len(), LAYOUTS_MAX);
            return Err(ConfigError::TooMany { file: file.to_owned(), key: "ingest.layouts", value, most });
        }
        self.check_driver().map_err(|cause| ConfigError::Syntax { file: file.to_owned(), cause: cause.into() })?;
        // The driver must not miss a command that `control` may still send. The lease must not pass to another client while
        // the robot still moves for the client that fell silent.
        let lease_least_ms = self.safety.input_stale_ms + STOP_LONGEST_MS;
        let sum = "the sum of safety.input_stale_ms and the longest stop, 500 ms";
        for (key, value, least, because) in [
            ("driver.grace_us", self.driver.grace_us, self.control.grace_us, "control.grace_us"),
            ("ingest.authority_timeout_ms", self.ingest.authority_timeout_ms, lease_least_ms, sum),
        ] {
            if value < least {
                return Err(ConfigError::TooShort { file: file.to_owned(), key, value, least, because });
            }
        }
        let (watchdog_ms, most) = (self.sim.watchdog_ms, self.sim.reaction.watchdog_max_ms());
        if watchdog_ms > most {
            let cause =
                format!("sim.watchdog_ms = {watchdog_ms} is above {most}, the most with sim.reaction = \"play\"");
            return Err(ConfigError::Syntax { file: file.to_owned(), cause });
        }
        Ok(())
    }

    fn check_driver(&self) -> Result<(), &'static str> {
        match (self.driver.kind, self.driver.interface) {
            (DriverKind::Sim, _) => Ok(()),
            (DriverKind::Robot, _) if self.driver.program.is_empty() => {
                Err("driver.kind = \"robot\" needs driver.program; name the program that drives your robot")
            }
            (DriverKind::Robot, None) => Err("driver.kind = \"robot\" needs driver.interface; say how your robot \
                                              interpolates between setpoints, \"direct\" or \"jtc100\""),
            (DriverKind::Robot, Some(Interface::Jtc100Restart)) => {
                Err("driver.interface = \"jtc100-restart\" is for a simulated robot only: nothing certifies it")
            }
            (DriverKind::Robot, Some(Interface::Direct | Interface::Jtc100)) => Ok(()),
        }
    }
}

/// Keys that files of before 0.1.0 have at another place: table, key, the values that belong to the old meaning, and the new
/// place.
const MOVED: [(&str, &str, &[&str], &str); 2] = [
    ("sim", "interface", &[], "driver.interface"),
    ("driver", "interface", &["trajectories", "positions", "arm_sdk"], "ros2.setpoints"),
];

fn moved_keys(table: &toml::Table) -> Vec<String> {
    let found = MOVED.iter().filter_map(|(section, key, values, place)| {
        let value = table.get(*section)?.get(*key)?;
        let is_old = values.is_empty() || value.as_str().is_some_and(|value| values.contains(&value));
        is_old.then(|| format!("{section}.{key} = {value} is now {place}"))
    });
    found.collect()
}
