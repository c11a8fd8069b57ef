//! `teleop.toml`: its structure and its bounds. Every key is required, and an unknown key is refused.

use crate::ConfigError;
use crate::cores::Cores;
use crate::interface::RobotInterface;
use ingest::Filter;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// All settings of one instance, as written in the file.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Settings {
    /// Robot file, relative to the settings file.
    pub robot: FileKey,
    /// Obstacles around the robot, in the frame of its base.
    pub environment: robot::Environment,
    /// Trained weights, as a path without extension, relative to the settings file. It names `FILE.safetensors` and
    /// `FILE.toml`.
    pub weights: FileKey,
    /// Retargeting.
    pub retarget: RetargetSettings,
    /// Groups of the sockets.
    pub doors: DoorSettings,
    /// The layouts that clients may send, and how their positions are filtered.
    pub ingest: IngestSettings,
    /// The control process.
    pub control: ControlSettings,
    /// The driver.
    pub driver: DriverSettings,
    /// Thresholds of the monitors.
    pub safety: SafetySettings,
    /// Scheduling, cores and memory.
    pub realtime: RealtimeSettings,
    /// Figures of the loops while they run.
    pub metrics: MetricsSettings,
    /// The simulated robot.
    pub sim: SimSettings,
}

/// A path, relative to the file that names it.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
pub struct FileKey {
    /// The path.
    pub file: String,
}

/// How a skeleton becomes joint positions.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Serialize, Eq)]
#[serde(rename_all = "kebab-case")]
pub enum Method {
    /// The shared latent space.
    Network,
    /// The geometric baseline.
    ClosedForm,
}

/// How skeletons become joint positions.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
pub struct RetargetSettings {
    /// Method that turns a skeleton into joint positions. `"network"` is the trained latent space, `"closed-form"` the
    /// geometric baseline.
    pub method: Method,
    /// Levenberg-Marquardt steps after the network. 0 to 10.
    pub refinement_steps: u32,
    /// Time from the capture of a person to the command that stands for it, ms. 0 to 250. A longer delay brings the
    /// robot nearer to the person's motion.
    pub following_delay_ms: f64,
    /// Network that predicts how a person goes on, as a path without extension, relative to the settings file. It names
    /// `FILE.safetensors` and `FILE.toml`. With `""` there is none, and the turn of each limb fades.
    pub prediction: String,
}

/// Groups of the sockets. An empty name stands for the group of the daemon's process.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
pub struct DoorSettings {
    /// Group whose members may publish skeletons through `skeleton.sock`. `""` is the group of the daemon's process.
    pub skeleton_group: String,
    /// Group whose members may command through `operator.sock`. `""` is the group of the daemon's process.
    pub operator_group: String,
}

/// Settings of the clients' layouts, lease and filter.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
pub struct IngestSettings {
    /// Silence after which a client's lease ends, ms. 100 to 60000. It is at least `safety.input_stale_ms` and the
    /// longest stop (500 ms), so the lease never passes on while the robot still moves.
    pub authority_timeout_ms: f64,
    /// Files of skeleton layouts beside the built-in ones, relative to the settings file. At most 16.
    pub layouts: Vec<String>,
    /// Folder of the files that `teleopctl calibrate` writes, relative to the settings file.
    pub operators: String,
    /// Layouts whose positions are filtered. `"cameras"` filters those that a camera sees, `"all"` filters every one,
    /// `"none"` filters none.
    pub filter: Filter,
    /// Cut-off of the One-Euro filter at rest, Hz. 0.5 to 100. It delays a joint at rest by 1 / (2 pi cut-off), which
    /// is 106 ms at 1.5 Hz. Assumption.
    pub filter_rest_cutoff_hz: f64,
    /// Growth of the cut-off with the joint's speed, Hz per m/s. 0 to 1000. With the shipped values the delay is 1 / (2
    /// pi (1.5 + 10 v) Hz) at v m/s, which is 14 ms at 1 m/s. Assumption.
    pub filter_cutoff_per_m: f64,
    /// Threshold of the Hampel filter, in scaled median deviations of the joint's last 7 frames. 0 to 20. A joint is an
    /// outlier if it comes further than that from where it could have gone, and further than 1.8 m/s times the period
    /// (6 cm at 30 Hz). An outlier is held for one frame. A second one in a row counts as motion. The filter delays by
    /// one frame where it holds, and by none elsewhere. 0 holds none.
    pub filter_outliers_mad: f64,
    /// Largest change of a limb's length in a camera's layout, in all, as a share. 0.01 to 0.5. Motion capture has
    /// 0.05. Assumption.
    pub camera_length_change_max: f64,
    /// Largest change of a limb's length in a camera's layout from frame to frame, as a share. 0.01 to 0.5. Motion
    /// capture has 0.02. Assumption.
    pub camera_length_step_max: f64,
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

/// Settings of the control process: its timing, and the conditions to engage and reset.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
pub struct ControlSettings {
    /// How long after its deadline tick k runs without a target, us. 0 to 600.
    pub grace_us: f64,
    /// Lets a machine without real-time scheduling engage. It counts with a simulated driver only.
    pub engage_without_realtime: bool,
    /// Operators that may reset an emergency stop of an operator. `"anyone"` allows every operator. `"presser"` requires a
    /// reset by every user who pressed it, or by root. SAFETY.md says more.
    pub emergency_stop_reset: EmergencyStopReset,
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

/// The robot that the driver talks to, and its timing.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
pub struct DriverSettings {
    /// Robot that the driver talks to. `"sim"` is a simulated one, `"robot"` a real one. A real one needs `program`, and
    /// nothing is relaxed for it.
    pub kind: DriverKind,
    /// Program that drives the robot, started in place of the driver of the built-in simulator. Empty for the built-in
    /// one. A path with a slash is relative to this file.
    pub program: String,
    /// How long after its deadline command k is due, us. From `control.grace_us` to 660.
    pub grace_us: f64,
    /// Silence of `control` that latches the driver's fault, ms. One tick (0.67) to 10. The stop plan plays from the
    /// first missed tick.
    pub silence_latch_ms: f64,
}

/// Thresholds of the monitors.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
pub struct SafetySettings {
    /// Silence of `retarget` that holds, ms. 1 to 50.
    pub target_stale_ms: f64,
    /// Silence of `retarget` from which the speed falls, ms. 0.5 to 50, below `target_stale_ms`. The speed is zero at
    /// `target_stale_ms`.
    pub target_late_ms: f64,
    /// Silence of the driver that holds, ms. 1 to 50, below `state_stale_ms`.
    pub state_late_ms: f64,
    /// Silence of the driver that stops and latches, ms. 2 to 100.
    pub state_stale_ms: f64,
    /// Silence of the skeleton from which the speed falls, ms. 5 to 500, below `input_stale_ms`. The speed is zero at
    /// `input_stale_ms`. At 50 ms one frame of 30 Hz may be lost.
    pub input_late_ms: f64,
    /// Silence of the skeleton that holds, ms. 10 to 500.
    pub input_stale_ms: f64,
    /// Silence of the operator's heartbeat that releases, ms. 40 to 1000.
    pub operator_silent_ms: f64,
    /// How long the enable must have been released since the start before a press counts, ms. 200 to 5000. A dead-man's
    /// handle that is stuck at the start never engages.
    pub enable_released_ms: f64,
    /// Longest hold, ms. 100 to 60000. Then the robot is released.
    pub hold_timeout_ms: f64,
    /// Largest tracking error of a turning joint that may last longer than `tracking_error_ms`, rad. 0.001 to 0.25,
    /// below `tracking_error_now_rad`. More stops. 5 mrad are 5 mm at 0.98 m of reach.
    pub tracking_error_rad: f64,
    /// Largest tracking error of a turning joint, rad. 0.001 to 0.5. More stops at once. 7 mrad are 7 mm at 0.98 m of
    /// reach, which is `clearance_min_mm` less `clearance_measured_min_mm`.
    pub tracking_error_now_rad: f64,
    /// As `tracking_error_rad`, for the torso lift, m. 0.0005 to 0.05, below `tracking_error_now_m`.
    pub tracking_error_m: f64,
    /// As `tracking_error_now_rad`, for the torso lift, m. 0.0005 to 0.1.
    pub tracking_error_now_m: f64,
    /// How long the smaller tracking error may last, ms. 1 to 500.
    pub tracking_error_ms: f64,
    /// How long the command may stay far behind a target that jumped, ms. 1 to 1000, below `target_jump_hold_ms`. Then
    /// the target is followed slowly.
    pub target_jump_slow_ms: f64,
    /// How long a target may jump again and again, ms. 100 to 5000. Then the robot holds.
    pub target_jump_hold_ms: f64,
    /// Missed deadlines in a row that make the robot slow for a second. 1 to 50, below `deadlines_missed_max`.
    pub deadlines_missed_slow: u32,
    /// Missed deadlines in a row that stop. 1 to 50.
    pub deadlines_missed_max: u32,
    /// Late ticks within a second that hold. 1 to 100.
    pub deadlines_late_per_s_max: u32,
    /// Factor on the stale times and on the number of missed deadlines above, where scheduling is not real-time. 1 to
    /// 50.
    pub stale_factor_without_realtime: f64,
    /// Largest speed of elbows and hands in the base frame, m/s. 0.05 to 3.
    pub hand_speed_max_m_per_s: f64,
    /// Limits elbows and hands to 0.25 m/s, the reduced speed of ISO 10218-1.
    pub hand_speed_reduced: bool,
}

/// Reduced speed, m/s: ISO 10218-1:2011, 5.6.2, 250 mm/s.
const HAND_SPEED_REDUCED_M_PER_S: f64 = 0.25;

impl SafetySettings {
    /// The bound on elbows and hands, m/s.
    pub fn hand_speed_m_per_s(&self) -> f64 {
        let reduced = if self.hand_speed_reduced { HAND_SPEED_REDUCED_M_PER_S } else { f64::INFINITY };
        self.hand_speed_max_m_per_s.min(reduced)
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

/// Prometheus text on the loopback interface.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
pub struct MetricsSettings {
    /// Port of the Prometheus text on 127.0.0.1. 0 to 65531. `ingest` has this port, and retarget, control, sim and
    /// robot have the next four. 0 serves none.
    pub port: u32,
}

/// Settings of scheduling, cores and memory.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
pub struct RealtimeSettings {
    /// Scheduling policy of the loops, `"fifo"` or `"other"`.
    pub policy: Policy,
    /// How the next process learns of a message. With `"events"` the writer wakes it. With `"polled"` each process
    /// looks once a period, which is slower and is there to compare.
    pub hand_off: HandOff,
    /// Locks the processes' memory, so that no page fault waits for a disk.
    pub lock_memory: bool,
    /// Real-time priority of retarget. 1 to 98.
    pub priority_retarget: u32,
    /// Real-time priority of control. 1 to 98.
    pub priority_control: u32,
    /// Real-time priority of the driver. 1 to 98.
    pub priority_driver: u32,
    /// Cores of retarget, control and driver. A list such as `[2, 3]` names 1 to 1024 cores, each 0 to 1023. `"free"`
    /// leaves them to the kernel. `"auto"` takes the first isolated core, or the last of 2 to 4, or none.
    pub cores: Cores,
    /// How long before each tick retarget watches the clock, us. 0 to 200. It wakes closer to the tick and keeps a core
    /// busy meanwhile. 100 costs 15 % of a core.
    pub spin_us: f64,
    /// Keeps every core awake while the daemon runs. It wakes sooner and uses more power.
    pub cpu_dma_latency: bool,
}

/// How the simulated robot reacts by itself when setpoints end. Real robots differ.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Serialize, Eq)]
#[serde(rename_all = "kebab-case")]
pub enum RobotReaction {
    /// Every joint brakes and holds its place.
    Hold,
    /// The motors damp.
    Damp,
    /// The drives play the stop that came with the last setpoint.
    Play,
}

impl RobotReaction {
    /// Converts it for the simulated robot.
    pub const fn simulated(self) -> sim::Reaction {
        match self {
            Self::Hold => sim::Reaction::Hold,
            Self::Damp => sim::Reaction::Damp,
            Self::Play => sim::Reaction::Play,
        }
    }
}

/// The simulated robot.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
pub struct SimSettings {
    /// How the simulated robot takes setpoints. `"direct"` takes every command. `"jtc100"` has four trajectory
    /// controllers, not synchronised, that take points at 100 Hz.
    pub interface: RobotInterface,
    /// Seed of the encoders' noise and of the delays of jtc100.
    pub seed: u64,
    /// Natural frequency of a joint's closed position loop, Hz. 1 to 50. Assumption for a geared arm joint.
    pub natural_frequency_hz: f64,
    /// Damping ratio of that loop. 0.1 to 1.5. Assumption.
    pub damping_ratio: f64,
    /// Factor on the bounds of the tracking error. 1 to 10. At all limits at once these soft drives stay 20 mrad
    /// behind, and nobody stands beside a simulated robot.
    pub tracking_error_factor: f64,
    /// Delay between driver and robot, in ticks of 1/1500 s. 0 to 30. Assumption of one field-bus cycle of 1 ms,
    /// rounded up.
    pub delay_ticks: u32,
    /// Silence of the driver after which the robot reacts by itself, ms. 1 to 20 with `reaction = "play"`, otherwise 1
    /// to 1000. Assumption.
    pub watchdog_ms: f64,
    /// Reaction of the robot by itself after that. `"play"` plays the certified stop that came with the last setpoint. Behind
    /// jtc100 no stop comes, and the joints brake alone. `"hold"` brakes each joint alone. `"damp"` lets the motors
    /// damp. Real robots differ.
    pub reaction: RobotReaction,
    /// Standard deviation of the encoders' noise, rad. 0 to 0.0001. Assumption of one step of the encoder.
    pub encoder_noise_rad: f64,
    /// Step of the encoders, rad. 0 to 0.01. Assumption of 17 bits per turn.
    pub encoder_step_rad: f64,
    /// Mass that the left hand truly carries, kg. 0 to 5. Without it the robot file's value counts. `control` learns a
    /// payload only from `teleopctl payload`.
    pub payload_left_kg: Option<f64>,
    /// As `payload_left_kg`, for the right hand, kg. 0 to 5.
    pub payload_right_kg: Option<f64>,
}

/// Largest number of layout files. Assumption: more than the systems of one laboratory. All of them are searched
/// for a number.
const LAYOUTS_MAX: usize = 16;

/// Longest stop of any robot, ms. `limits.stop_time_max_ms` of a robot file may not exceed it.
const STOP_LONGEST_MS: f64 = 500.0;

impl Settings {
    /// Parses `text` and checks its bounds. Errors name `file`.
    pub fn parse(file: &str, text: &str) -> Result<Self, ConfigError> {
        let settings: Self = toml::from_str(text)
            .map_err(|error| ConfigError::Syntax { file: file.to_owned(), cause: error.to_string() })?;
        settings.check(file)?;
        Ok(settings)
    }

    /// Factor on the bounds of the tracking error. It is one, except for a simulated robot.
    pub const fn tracking_error_factor(&self) -> f64 {
        match self.driver.kind {
            DriverKind::Sim => self.sim.tracking_error_factor,
            DriverKind::Robot => 1.0,
        }
    }

    /// Returns the program that drives the robot in place of the simulated one. `None` if there is none. A path with a
    /// slash is relative to the settings file `config`. A bare name is searched in PATH.
    pub fn driver_program(&self, config: &Path) -> Option<PathBuf> {
        let program = Path::new(&self.driver.program);
        match program.components().count() {
            0 => None,
            1 if !self.driver.program.contains('/') => Some(program.to_owned()),
            _ => Some(config.parent().unwrap_or(Path::new("")).join(program)),
        }
    }

    /// Returns the known delay of the servos, ticks. None is assumed of a real robot.
    pub const fn servo_delay_ticks(&self) -> u32 {
        match self.driver.kind {
            DriverKind::Sim => self.sim.delay_ticks,
            DriverKind::Robot => 0,
        }
    }

    fn check(&self, file: &str) -> Result<(), ConfigError> {
        let t = 1000.0 / messages::TICK_HZ as f64;
        let bounds = [
            ("retarget.refinement_steps", f64::from(self.retarget.refinement_steps), 0.0, 10.0),
            ("retarget.following_delay_ms", self.retarget.following_delay_ms, 0.0, 250.0),
            ("ingest.authority_timeout_ms", self.ingest.authority_timeout_ms, 100.0, 60_000.0),
            ("ingest.filter_rest_cutoff_hz", self.ingest.filter_rest_cutoff_hz, 0.5, 100.0),
            ("ingest.filter_cutoff_per_m", self.ingest.filter_cutoff_per_m, 0.0, 1000.0),
            ("ingest.filter_outliers_mad", self.ingest.filter_outliers_mad, 0.0, 20.0),
            ("ingest.camera_length_change_max", self.ingest.camera_length_change_max, 0.01, 0.5),
            ("ingest.camera_length_step_max", self.ingest.camera_length_step_max, 0.01, 0.5),
            ("control.grace_us", self.control.grace_us, 0.0, 600.0),
            ("driver.grace_us", self.driver.grace_us, self.control.grace_us, 660.0),
            ("driver.silence_latch_ms", self.driver.silence_latch_ms, t, 10.0),
            ("safety.stale_factor_without_realtime", self.safety.stale_factor_without_realtime, 1.0, 50.0),
            ("safety.hand_speed_max_m_per_s", self.safety.hand_speed_max_m_per_s, 0.05, 3.0),
            ("realtime.priority_retarget", f64::from(self.realtime.priority_retarget), 1.0, 98.0),
            ("realtime.priority_control", f64::from(self.realtime.priority_control), 1.0, 98.0),
            ("realtime.priority_driver", f64::from(self.realtime.priority_driver), 1.0, 98.0),
            ("realtime.spin_us", self.realtime.spin_us, 0.0, 200.0),
            ("metrics.port", f64::from(self.metrics.port), 0.0, 65_531.0),
            ("sim.natural_frequency_hz", self.sim.natural_frequency_hz, 1.0, 50.0),
            ("sim.tracking_error_factor", self.sim.tracking_error_factor, 1.0, 10.0),
            ("sim.damping_ratio", self.sim.damping_ratio, 0.1, 1.5),
            ("sim.delay_ticks", f64::from(self.sim.delay_ticks), 0.0, f64::from(sim::DELAY_MAX_TICKS)),
            ("sim.watchdog_ms", self.sim.watchdog_ms, 1.0, sim::watchdog_max_ms(self.sim.reaction.simulated())),
            ("sim.encoder_noise_rad", self.sim.encoder_noise_rad, 0.0, sim::ENCODER_NOISE_MAX_RAD),
            ("sim.encoder_step_rad", self.sim.encoder_step_rad, 0.0, 0.01),
            ("sim.payload_left_kg", self.sim.payload_left_kg.unwrap_or_default(), 0.0, robot::PAYLOAD_MAX_KG),
            ("sim.payload_right_kg", self.sim.payload_right_kg.unwrap_or_default(), 0.0, robot::PAYLOAD_MAX_KG),
        ];
        for (key, value, low, high) in bounds.into_iter().chain(self.realtime.cores.bounds()) {
            // Written so that NaN is refused too.
            if !(value >= low && value <= high) {
                return Err(ConfigError::Bound { file: file.to_owned(), key: key.to_owned(), value, low, high });
            }
        }
        if self.ingest.layouts.len() > LAYOUTS_MAX {
            let (value, most) = (self.ingest.layouts.len(), LAYOUTS_MAX);
            return Err(ConfigError::TooMany { file: file.to_owned(), key: "ingest.layouts", value, most });
        }
        if self.driver.kind == DriverKind::Robot && self.driver.program.is_empty() {
            return Err(ConfigError::Syntax {
                file: file.to_owned(),
                cause: "driver.kind = \"robot\" needs driver.program; name the program that drives your robot".into(),
            });
        }
        // The lease must not pass to another client while the robot still moves for the client that fell silent.
        let (value, least) = (self.ingest.authority_timeout_ms, self.safety.input_stale_ms + STOP_LONGEST_MS);
        if value < least {
            return Err(ConfigError::TooShort {
                file: file.to_owned(),
                key: "ingest.authority_timeout_ms".to_owned(),
                value,
                least,
                because: "the sum of safety.input_stale_ms and the longest stop, 500 ms",
            });
        }
        Ok(())
    }
}
