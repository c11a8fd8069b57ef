//! The interface between the driver and the robot's controllers: how often it is used, and whether the robot file agrees to it.

use crate::trajectory::PERIOD_TICKS;
use config::Settings;
use robot::{DriverInterface, Model};

/// Ticks between two positions: 2 ms. Source: the controllers of Reachy 2 update at 500 Hz (reachy2_core,
/// `reachy_full_kit_controllers.yaml`). A slower controller takes the newest one.
const POSITIONS_TICKS: u64 = 3;
/// Ticks between two messages to `rt/arm_sdk`: 4 ms. Source: `control_dt` of xr_teleoperate.
const ARM_SDK_TICKS: u64 = 6;

/// Ticks between two messages.
pub const fn period_ticks(interface: DriverInterface) -> u64 {
    match interface {
        DriverInterface::Trajectories => PERIOD_TICKS,
        DriverInterface::Positions => POSITIONS_TICKS,
        DriverInterface::ArmSdk => ARM_SDK_TICKS,
    }
}

/// Least `driver.measured_age_max_ms` with joint states at 50 Hz: three periods. A state is up to 30 ms old when the next one
/// is under way, and one may be lost.
const AGE_MAX_LEAST_MS: f64 = 60.0;

/// Returns a sentence on the first setting that does not suit the robot. An interface without a certified stop must be named
/// by the settings and by the robot file.
pub fn disagreement(settings: &Settings, model: &Model) -> Option<String> {
    let (wanted, interface, file) = (model.driver.interface, settings.driver.interface, &model.texts.toml_name);
    if wanted != interface {
        return Some(format!(
            "driver.interface = \"{}\", must be \"{}\" as in [driver] of {file}. The page `A robot on ROS 2` of the book \
             says how such a robot stops",
            interface.name(),
            wanted.name()
        ));
    }
    if settings.sim.interface != config::RobotInterface::Jtc100 {
        return Some(format!(
            "sim.interface = \"{}\", must be \"jtc100\": delays that differ by 10 ms are what whole-body control must certify",
            settings.sim.interface.name()
        ));
    }
    let age_ms = settings.driver.measured_age_max_ms;
    (interface == DriverInterface::Trajectories && age_ms < AGE_MAX_LEAST_MS).then(|| {
        format!(
            "driver.measured_age_max_ms = {age_ms}, must be {AGE_MAX_LEAST_MS} or more: joint states come every 20 ms"
        )
    })
}
