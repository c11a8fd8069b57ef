//! Converts the settings into the stages' configurations.

use crate::simulated;
use config::{ConfigError, DriverKind, IngestSettings, Loaded, Operators, Settings};
use driver::Interface;
use layouts::{Layouts, Lifter, Noise};
use messages::JOINTS_MAX;
use retarget::ArmModel;
use safety::{engage, gate, gripper};

/// Longest motion of a joint in a 30th of a second that the filter smooths, m: 4.5 m/s. After a longer one the
/// filter restarts at the new position. Few movements are that fast, and none of them needs smoothing.
const FILTER_STEP_M: f64 = 0.15;

/// Returns the configuration of `ingest`.
pub fn input_config(
    settings: &IngestSettings,
    layouts: Layouts,
    operators: &Operators,
    lifter: Option<Lifter>,
) -> ingest::Config {
    let measured = skeleton::Config::default();
    ingest::Config {
        layouts,
        lifter,
        calibrations: operators.calibrations(),
        filter: settings.filter,
        mirror: settings.mirror,
        noise: Noise {
            rest_cutoff_hz: settings.filter_rest_cutoff_hz,
            cutoff_per_m: settings.filter_cutoff_per_m,
            outliers_mad: settings.filter_outliers_mad,
            step_max_m: FILTER_STEP_M,
            confidence_min: measured.confidence_min,
        },
        // The lengths in a camera's frame are those of the session.
        seen: skeleton::Config { length_change_max: f64::INFINITY, length_step_max: f64::INFINITY, ..measured },
        measured,
    }
}

/// Returns the configuration of the retargeting stage.
pub fn retarget_config(loaded: &Loaded) -> Result<retarget::Config, ConfigError> {
    retarget::Config::new(&loaded.model, loaded.weights.clone(), &loaded.settings.retarget)
        .map(|config| config.with_prediction(loaded.prediction.clone()))
        .map_err(|error| ConfigError::stage("retarget", error))
}

/// Returns the configuration of the stage that samples a policy's chunks.
pub fn policy_config(loaded: &Loaded) -> retarget::policy::Config {
    retarget::policy::Config::new(&loaded.model, (loaded.settings.ingest.authority_timeout_ms * 1e6) as u64)
}

/// Returns the configuration of the control tick. Without real-time scheduling (`realtime` false), the stale times
/// are relaxed by the factor of the settings.
pub fn control_config(loaded: &Loaded, realtime: bool) -> Result<control::Config, ConfigError> {
    let model = loaded.model.clone();
    let (safety, interface) = (&loaded.settings.safety, loaded.settings.interface());
    let tracking = loaded.settings.tracking_error_factor();
    let (hand_speed, grippers) = (safety.hand_speed_m_per_s(), checker::grippers(&model));
    let options = wbc::Options::default().interface(certified(interface)).hand_speed_m_per_s(hand_speed);
    let engage = if realtime { engage::Config::new(safety) } else { engage::Config::relaxed(safety) };
    let wbc = wbc::Config::new(&model, options).map_err(|error| ConfigError::stage("whole-body control", error))?;
    Ok(control::Config {
        engage: engage
            .map(|engage| engage.with_tracking_factor(tracking))
            .map_err(|error| ConfigError::Syntax { file: loaded.config_name(), cause: error.to_string() })?,
        gate: gate::Config::with_interface(&model, &gated(interface, &model))
            .and_then(|gate| gate.with_hand_speed(hand_speed))
            .map_err(|error| ConfigError::stage("gate", error))?,
        grippers,
        gripper_gate: gripper::Config {
            speed: grippers.0,
            acceleration: grippers.0.map(|speed| speed / driver::GRIPPER_RAMP_S),
        },
        open_grippers_when_disengaged: loaded.settings.control.open_grippers_when_disengaged,
        follow: follow::Config::new(&model, &wbc.bounds().map(|bound| bound.v_max), follow::Weights::default()),
        wbc,
        arms: ArmModel::both(&model),
        servo_lag_s: f64::from(loaded.settings.servo_delay_ticks()) * messages::TICK_S + interface.delay_s(),
        tracking_max: [safety.tracking_error_rad, safety.tracking_error_m].map(|bound| bound * tracking),
        config_hash: loaded.hash,
        realtime,
        model,
    })
}

/// Age by which a measurement is older after a pause that real-time scheduling would prevent, ms: ten cycles of a port
/// of 1 kHz for each factor.
const PAUSE_MS: f64 = 10.0;
/// Longest such pause, ms.
const PAUSE_MAX_MS: f64 = 1000.0;

/// Returns the configuration of the driver and of the checker of its steps. Without real-time scheduling (`realtime` false),
/// two times are relaxed like the other stale times: the silence that latches the driver's fault, and the age of a
/// measurement. The plan plays from the first missed tick in any case. The driver of a simulated robot does not latch before
/// `control` counts the state as stale, because a pause of the simulation's process is no fault of a robot.
///
/// # Errors
/// Returns an error if the checker refuses a setting, or the robot's files.
pub fn driver_config(loaded: &Loaded, realtime: bool) -> Result<checker::Config, ConfigError> {
    checker::Config::new(&loaded.model, &driver_options(loaded, realtime, false))
        .map_err(|error| ConfigError::stage("driver", error))
}

/// Returns the configuration of the simulated robot, and its posture at the start, rad or m.
///
/// # Errors
/// Returns an error if the simulated robot refuses a setting, or the robot's files.
pub fn robot_config(loaded: &Loaded) -> Result<(plant::Config, [f64; JOINTS_MAX]), ConfigError> {
    simulated::robot_config(&loaded.model, &robot_options(loaded, false), None)
        .map_err(|error| ConfigError::stage("simulated robot", error))
}

/// Returns the configuration of the simulated robot and of its driver in one thread. With `initial_outside` the robot may
/// start outside its limits, see [`checker::Options`].
///
/// # Errors
/// Returns an error if a setting or the robot's files are refused.
pub fn simulated_config(loaded: &Loaded, initial_outside: bool) -> Result<simulated::Config, ConfigError> {
    let (driver, robot) = (driver_options(loaded, true, initial_outside), robot_options(loaded, initial_outside));
    simulated::Config::new(&loaded.model, &simulated::Options { driver, robot, initial: None })
        .map_err(|error| ConfigError::stage("simulated robot", error))
}

fn driver_options(loaded: &Loaded, realtime: bool, initial_outside: bool) -> checker::Options {
    let Settings { driver, safety, sim, .. } = &loaded.settings;
    let factor = if realtime { 1.0 } else { safety.stale_factor_without_realtime };
    let pause_ms = match driver.kind {
        DriverKind::Sim if driver.program.is_empty() => PAUSE_MS.max(safety.state_stale_ms),
        DriverKind::Sim | DriverKind::Robot => PAUSE_MS,
    };
    checker::Options {
        interface: loaded.settings.interface(),
        measured_age_max_ms: driver.measured_age_max_ms,
        pause_ms: (pause_ms * (factor - 1.0)).min(PAUSE_MAX_MS),
        silence_ticks: (driver.silence_latch_ms * factor * 1e-3 * messages::TICK_HZ as f64).round() as u64,
        hand_speed_max_m_per_s: safety.hand_speed_m_per_s(),
        payload_kg: match driver.kind {
            DriverKind::Sim => [sim.payload_left_kg, sim.payload_right_kg],
            DriverKind::Robot => [None; 2],
        },
        initial_outside,
    }
}

fn robot_options(loaded: &Loaded, initial_outside: bool) -> plant::Options {
    let settings = &loaded.settings.sim;
    plant::Options {
        natural_frequency_hz: settings.natural_frequency_hz,
        damping_ratio: settings.damping_ratio,
        delay_ns: (f64::from(settings.delay_ticks) * messages::TICK_S * 1e9).round() as u64,
        encoder_noise_rad: settings.encoder_noise_rad,
        encoder_step_rad: settings.encoder_step_rad,
        watchdog_ns: (settings.watchdog_ms * 1e6) as u64,
        reaction: settings.reaction,
        hands_kg: [settings.payload_left_kg, settings.payload_right_kg],
        object_width_m: settings.object_width_m,
        initial_outside,
        ..plant::Options::default()
    }
}

/// Converts an interface for the certificate.
pub(crate) fn certified(interface: Interface) -> wbc::Interface {
    match interface {
        Interface::Direct => wbc::Interface::default(),
        Interface::Jtc100 | Interface::Jtc100Restart => wbc::Interface::JTC_100_HZ,
    }
}

/// Converts an interface for the gate, with the model's controllers. A spline through points every
/// h deviates from a motion with the jerk limit J by at most J h^3 / 96.
pub(crate) fn gated(interface: Interface, model: &robot::Model) -> gate::Interface {
    match interface {
        Interface::Direct => gate::Interface::default(),
        Interface::Jtc100 | Interface::Jtc100Restart => {
            let wbc::Interface { skew_s, period_s, .. } = wbc::Interface::JTC_100_HZ;
            let spline = |j: usize| model.limits[j].j_max * period_s * period_s * period_s / 96.0;
            let of = |j: usize| model.controllers.iter().position(|controller| controller.joints & 1 << j != 0);
            let controller = |j: usize| of(j).unwrap_or(0);
            gate::Interface { off: std::array::from_fn(spline), skew_s, controller: std::array::from_fn(controller) }
        }
    }
}
