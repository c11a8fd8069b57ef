//! The interface between the driver and the robot's controllers: how often it is used, and whether the robot file agrees to it.

use crate::trajectory::PERIOD_TICKS;
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

/// Returns a sentence if `driver.interface` of the settings is not that of the robot file. Both must name an interface
/// without a certified stop.
pub fn disagreement(interface: DriverInterface, model: &Model) -> Option<String> {
    let (wanted, found, file) = (model.driver.interface, interface.name(), &model.texts.toml_name);
    (wanted != interface).then(|| {
        format!(
            "driver.interface = \"{found}\", must be \"{}\" as in [driver] of {file}. The page `A robot on ROS 2` of the book \
             says how such a robot stops",
            wanted.name()
        )
    })
}
