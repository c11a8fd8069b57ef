//! `teleop.toml`: its shape and its bounds. Every key is required; an unknown key is refused.

use crate::ConfigError;
use crate::cores::Cores;
use messages::{HEAD, LEFT_ARM, TORSO};
use serde::{Deserialize, Serialize};

/// All settings of one instance, as written in the file.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Settings {
    /// Robot description.
    pub robot: FileKey,
    /// What stands about the robot.
    pub environment: robot::Environment,
    /// Trained weights, without extension.
    pub weights: FileKey,
    /// Retargeting.
    pub retarget: RetargetSettings,
    /// Who may come in.
    pub doors: DoorSettings,
    /// What clients bring.
    pub ingest: IngestSettings,
    /// The control process.
    pub control: ControlSettings,
    /// The driver's side of the command stream.
    pub driver: DriverSettings,
    /// Thresholds of the monitors.
    pub safety: SafetySettings,
    /// What is asked of the kernel.
    pub realtime: RealtimeSettings,
    /// What is told of the loops while they run.
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

#[allow(missing_docs)]
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
pub struct RetargetSettings {
    pub method: Method,
    pub refinement_steps: u32,
    pub following_delay_ms: f64,
    /// Without extension, relative to the settings file; empty: none.
    pub prediction: String,
}

/// Groups of the sockets; an empty name is the group of the daemon's process.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
pub struct DoorSettings {
    /// Whose members may publish skeletons.
    pub skeleton_group: String,
    /// Whose members may command.
    pub operator_group: String,
}

/// Whose positions are filtered before they are judged.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Serialize, Eq)]
#[serde(rename_all = "kebab-case")]
pub enum Filter {
    /// Nobody's.
    None,
    /// Those that a camera sees.
    Cameras,
    /// Everybody's.
    All,
}

/// What clients may send, and for how long they may be silent.
#[allow(missing_docs)]
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
pub struct IngestSettings {
    pub authority_timeout_ms: f64,
    /// Files of layouts beside the built-in ones, relative to the settings.
    pub layouts: Vec<String>,
    /// Folder of the operators' files, relative to the settings.
    pub operators: String,
    pub filter: Filter,
    pub filter_rest_cutoff_hz: f64,
    pub filter_cutoff_per_m: f64,
    pub filter_outliers_mad: f64,
    pub camera_length_change_max: f64,
    pub camera_length_step_max: f64,
}

/// Who may reset an emergency stop that an operator pressed.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Serialize, Eq)]
#[serde(rename_all = "kebab-case")]
pub enum EmergencyStopReset {
    /// Every operator.
    Anyone,
    /// The user who pressed it, or root.
    Presser,
}

impl EmergencyStopReset {
    /// As the operator's socket calls it.
    pub const fn rule(self) -> operator::ResetRule {
        match self {
            Self::Anyone => operator::ResetRule::Anyone,
            Self::Presser => operator::ResetRule::Presser,
        }
    }
}

#[allow(missing_docs)]
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
pub struct ControlSettings {
    pub grace_us: f64,
    pub engage_without_realtime: bool,
    pub emergency_stop_reset: EmergencyStopReset,
}

/// Which robot the driver talks to.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Serialize, Eq)]
#[serde(rename_all = "kebab-case")]
pub enum DriverKind {
    /// The simulated robot.
    Sim,
}

#[allow(missing_docs)]
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
pub struct DriverSettings {
    pub kind: DriverKind,
    pub grace_us: f64,
    pub silence_latch_ms: f64,
}

#[allow(missing_docs)]
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
pub struct SafetySettings {
    pub target_stale_ms: f64,
    pub target_late_ms: f64,
    pub state_late_ms: f64,
    pub state_stale_ms: f64,
    pub input_late_ms: f64,
    pub input_stale_ms: f64,
    pub operator_silent_ms: f64,
    pub enable_released_ms: f64,
    pub hold_timeout_ms: f64,
    pub tracking_error_rad: f64,
    pub tracking_error_now_rad: f64,
    pub tracking_error_m: f64,
    pub tracking_error_now_m: f64,
    pub tracking_error_ms: f64,
    pub target_jump_slow_ms: f64,
    pub target_jump_hold_ms: f64,
    pub deadlines_missed_slow: u32,
    pub deadlines_missed_max: u32,
    pub deadlines_late_per_s_max: u32,
    pub stale_factor_without_realtime: f64,
    pub hand_speed_max_m_per_s: f64,
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

/// Scheduling policy asked for.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Serialize, Eq)]
#[serde(rename_all = "kebab-case")]
pub enum Policy {
    /// SCHED_FIFO.
    Fifo,
    /// SCHED_OTHER.
    Other,
}

/// How the next process learns that there is something for it.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Serialize, Eq)]
#[serde(rename_all = "kebab-case")]
pub enum HandOff {
    /// The writer wakes it.
    Events,
    /// It looks once a period.
    Polled,
}

/// Prometheus text on the loopback interface.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
pub struct MetricsSettings {
    /// Port of the first process, of the others those that follow; 0 serves none.
    pub port: u32,
}

#[allow(missing_docs)]
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
pub struct RealtimeSettings {
    pub policy: Policy,
    pub hand_off: HandOff,
    pub lock_memory: bool,
    pub priority_retarget: u32,
    pub priority_control: u32,
    pub priority_driver: u32,
    pub cores: Cores,
    pub spin_us: f64,
    pub cpu_dma_latency: bool,
}

/// What the simulated robot does by itself when setpoints end; real robots differ.
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
    /// As the simulated robot calls it.
    pub(crate) const fn simulated(self) -> sim::Reaction {
        match self {
            Self::Hold => sim::Reaction::Hold,
            Self::Damp => sim::Reaction::Damp,
            Self::Play => sim::Reaction::Play,
        }
    }
}

/// How the simulated robot takes what its driver executes.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Serialize, Eq)]
#[serde(rename_all = "kebab-case")]
pub enum RobotInterface {
    /// Every command at its index.
    Direct,
    /// Four joint trajectory controllers, not synchronised, that take points at 100 Hz.
    Jtc100,
}

impl RobotInterface {
    /// All of them.
    pub const ALL: [Self; 2] = [Self::Direct, Self::Jtc100];

    /// Its name in settings and on the command line.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Direct => "direct",
            Self::Jtc100 => "jtc100",
        }
    }

    /// As the simulated robot calls it.
    pub(crate) const fn simulated(self) -> sim::Interface {
        match self {
            Self::Direct => sim::Interface::Direct,
            Self::Jtc100 => sim::Interface::Jtc100,
        }
    }

    /// As the certificate knows it.
    pub(crate) fn certified(self) -> wbc::Interface {
        match self {
            Self::Direct => wbc::Interface::default(),
            Self::Jtc100 => wbc::Interface::JTC_100_HZ,
        }
    }

    /// As the gate knows it: controllers of torso, head, left arm and right arm. Splines through points every h leave a
    /// motion with the jerk limit J by at most J h^3 / 96.
    pub fn gated(self, model: &robot::Model) -> safety::gate::Interface {
        match self {
            Self::Direct => safety::gate::Interface::default(),
            Self::Jtc100 => {
                let wbc::Interface { skew_s, period_s, .. } = wbc::Interface::JTC_100_HZ;
                let spline = |j: usize| model.limits[j].j_max * period_s * period_s * period_s / 96.0;
                let controller = |j: usize| match j {
                    TORSO => 0,
                    _ if HEAD.contains(&j) => 1,
                    _ if LEFT_ARM.contains(&j) => 2,
                    _ => 3,
                };
                safety::gate::Interface {
                    off: std::array::from_fn(spline),
                    skew_s,
                    controller: std::array::from_fn(controller),
                }
            }
        }
    }
}

#[allow(missing_docs)]
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
pub struct SimSettings {
    pub interface: RobotInterface,
    pub seed: u64,
    pub natural_frequency_hz: f64,
    pub damping_ratio: f64,
    pub tracking_error_factor: f64,
    pub delay_ticks: u32,
    pub watchdog_ms: f64,
    pub reaction: RobotReaction,
    pub encoder_noise_rad: f64,
    pub encoder_step_rad: f64,
    /// What the left hand truly carries, kg; without it what the robot file says.
    pub payload_left_kg: Option<f64>,
    /// The same of the right hand.
    pub payload_right_kg: Option<f64>,
}

/// The most files of layouts: assumption, more than the systems of one laboratory. A number is looked for among all of them.
const LAYOUTS_MAX: usize = 16;

/// The longest stop of any robot, ms (`limits.stop_time_max_ms` of a robot file may not exceed it).
const STOP_LONGEST_MS: f64 = 500.0;

impl Settings {
    /// Parses and bounds `text`; `file` is named in errors.
    pub fn parse(file: &str, text: &str) -> Result<Self, ConfigError> {
        let settings: Self = toml::from_str(text)
            .map_err(|error| ConfigError::Syntax { file: file.to_owned(), cause: error.to_string() })?;
        settings.check(file)?;
        Ok(settings)
    }

    /// What the bounds of the tracking error are multiplied by: one, but for a simulated robot.
    pub(crate) const fn tracking_error_factor(&self) -> f64 {
        match self.driver.kind {
            DriverKind::Sim => self.sim.tracking_error_factor,
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
        // The lease must not pass on while the robot still moves for the client that fell silent.
        let (value, least) = (self.ingest.authority_timeout_ms, self.safety.input_stale_ms + STOP_LONGEST_MS);
        if value < least {
            return Err(ConfigError::TooShort {
                file: file.to_owned(),
                key: "ingest.authority_timeout_ms".to_owned(),
                value,
                least,
                because: "safety.input_stale_ms and the longest stop, 500 ms",
            });
        }
        Ok(())
    }
}
