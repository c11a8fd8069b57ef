//! Converts the settings into the stages' configurations.

use config::{ConfigError, IngestSettings, Loaded, Operators, RobotInterface};
use layouts::{Layouts, Noise};
use retarget::ArmModel;
use safety::{engage, gate, gripper};

/// Longest motion of a joint in a 30th of a second that the filter smooths, m: 4.5 m/s. After a longer one the
/// filter restarts at the new position. Few movements are that fast, and none of them needs smoothing.
const FILTER_STEP_M: f64 = 0.15;

/// Returns the configuration of `ingest`.
pub fn input_config(settings: &IngestSettings, layouts: Layouts, operators: &Operators) -> ingest::Config {
    let measured = skeleton::Config::default();
    ingest::Config {
        layouts,
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
        seen: skeleton::Config {
            length_change_max: settings.camera_length_change_max,
            length_step_max: settings.camera_length_step_max,
            ..measured
        },
        measured,
    }
}

/// Returns the configuration of the retargeting stage.
pub fn retarget_config(loaded: &Loaded) -> Result<retarget::Config, ConfigError> {
    retarget::Config::new(&loaded.model, loaded.weights.clone(), &loaded.settings.retarget)
        .map(|config| config.with_prediction(loaded.prediction.clone()))
        .map_err(|error| ConfigError::stage("retarget", error))
}

/// Returns the configuration of the control tick. Without real-time scheduling (`realtime` false), the stale times
/// are relaxed by the factor of the settings.
pub fn control_config(loaded: &Loaded, realtime: bool) -> Result<control::Config, ConfigError> {
    let model = loaded.model.clone();
    let (safety, interface) = (&loaded.settings.safety, loaded.settings.sim.interface);
    let tracking = loaded.settings.tracking_error_factor();
    let (hand_speed, grippers) = (safety.hand_speed_m_per_s(), sim::grippers(&model));
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
        arm: ArmModel::of(&model),
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

/// Returns the configuration of the simulated robot. Without real-time scheduling (`realtime` false), two times
/// are relaxed like the other stale times: the silence that latches the driver's fault, and the age of a
/// measurement. The plan plays from the first missed tick in any case.
pub fn sim_config(loaded: &Loaded, realtime: bool) -> Result<sim::Config, ConfigError> {
    sim_config_of(loaded, realtime, false)
}

/// As [`sim_config`]; for `initial_outside` see [`sim::Options`].
pub(crate) fn sim_config_of(
    loaded: &Loaded,
    realtime: bool,
    initial_outside: bool,
) -> Result<sim::Config, ConfigError> {
    let (settings, driver) = (&loaded.settings.sim, &loaded.settings.driver);
    let factor = if realtime { 1.0 } else { loaded.settings.safety.stale_factor_without_realtime };
    let options = sim::Options {
        interface: settings.interface,
        natural_frequency_hz: settings.natural_frequency_hz,
        damping_ratio: settings.damping_ratio,
        delay_ticks: settings.delay_ticks,
        encoder_noise_rad: settings.encoder_noise_rad,
        encoder_step_rad: settings.encoder_step_rad,
        watchdog_ms: settings.watchdog_ms,
        reaction: settings.reaction,
        measured_age_max_ms: driver.measured_age_max_ms,
        pause_ms: PAUSE_MS * (factor - 1.0),
        silence_ticks: (driver.silence_latch_ms * factor * 1e-3 * messages::TICK_HZ as f64).round() as u64,
        hand_speed_max_m_per_s: loaded.settings.safety.hand_speed_m_per_s(),
        payload_kg: [settings.payload_left_kg, settings.payload_right_kg],
        object_width_m: settings.object_width_m,
        initial_outside,
        ..sim::Options::default()
    };
    sim::Config::new(&loaded.model, &options).map_err(|error| ConfigError::stage("sim", error))
}

/// Converts an interface for the certificate.
pub(crate) fn certified(interface: RobotInterface) -> wbc::Interface {
    match interface {
        RobotInterface::Direct => wbc::Interface::default(),
        RobotInterface::Jtc100 | RobotInterface::Jtc100Restart => wbc::Interface::JTC_100_HZ,
    }
}

/// Converts an interface for the gate, with the model's controllers. A spline through points every
/// h deviates from a motion with the jerk limit J by at most J h^3 / 96.
pub(crate) fn gated(interface: RobotInterface, model: &robot::Model) -> gate::Interface {
    match interface {
        RobotInterface::Direct => gate::Interface::default(),
        RobotInterface::Jtc100 | RobotInterface::Jtc100Restart => {
            let wbc::Interface { skew_s, period_s, .. } = wbc::Interface::JTC_100_HZ;
            let spline = |j: usize| model.limits[j].j_max * period_s * period_s * period_s / 96.0;
            let of = |j: usize| model.controllers.iter().position(|controller| controller.joints & 1 << j != 0);
            let controller = |j: usize| of(j).unwrap_or(0);
            gate::Interface { off: std::array::from_fn(spline), skew_s, controller: std::array::from_fn(controller) }
        }
    }
}
