//! The interface between the driver and the robot's controllers: how often it is used, and whether the robot file agrees to it.

use crate::trajectory::PERIOD_TICKS;
use config::Settings;
use driver::Interface;
use robot::{Model, SetpointKind};

/// Ticks between two positions: 2 ms. Source: the controllers of Reachy 2 update at 500 Hz (reachy2_core,
/// `reachy_full_kit_controllers.yaml`). A slower controller takes the newest one.
const POSITIONS_TICKS: u64 = 3;
/// Ticks between two messages to `rt/arm_sdk`: 4 ms. Source: `control_dt` of xr_teleoperate.
const ARM_SDK_TICKS: u64 = 6;

/// Ticks between two messages.
pub const fn period_ticks(interface: SetpointKind) -> u64 {
    match interface {
        SetpointKind::Trajectories => PERIOD_TICKS,
        SetpointKind::Positions => POSITIONS_TICKS,
        SetpointKind::ArmSdk => ARM_SDK_TICKS,
    }
}

/// Least `driver.measured_age_max_ms` with joint states at 50 Hz: three periods. A state is up to 30 ms old when the next one
/// is under way, and one may be lost.
const AGE_MAX_LEAST_MS: f64 = 60.0;

/// How every robot behind this driver interpolates: its controllers' delays differ by up to 10 ms.
pub const INTERFACE: Interface = Interface::Jtc100;

/// Returns a sentence on the first setting that does not suit the robot. An interface without a certified stop must be named
/// by the settings and by the robot file.
pub fn disagreement(settings: &Settings, model: &Model) -> Option<String> {
    let (wanted, setpoints, file) = (model.driver.setpoints, settings.ros2.setpoints, &model.texts.toml_name);
    if wanted != setpoints {
        return Some(format!(
            "ros2.setpoints = \"{}\", must be \"{}\" as in [driver] of {file}. The page `A robot on ROS 2` of the book \
             says how such a robot stops",
            setpoints.name(),
            wanted.name()
        ));
    }
    if let Err(refusal) = settings.check_declared(INTERFACE) {
        return Some(refusal);
    }
    let age_ms = settings.driver.measured_age_max_ms;
    (setpoints == SetpointKind::Trajectories && age_ms < AGE_MAX_LEAST_MS).then(|| {
        format!(
            "driver.measured_age_max_ms = {age_ms}, must be {AGE_MAX_LEAST_MS} or more: joint states come every 20 ms"
        )
    })
}
