//! Composes the stages: their configurations from the settings, and all of them in one thread with virtual time, for offline
//! replay and for simulation.

mod certify;
mod offline;
pub mod simulated;
mod stages;
mod tamper;
mod world;

pub use certify::{CertifiedRow, Uncertified, certify};
pub use offline::{Offline, OfflineEnd, OfflineReport, PlayedTick, Row};
pub use stages::{
    control_config, driver_config, input_config, policy_config, retarget_config, robot_config, simulated_config,
};
pub use tamper::{Tamper, Untampered};
pub use world::{Links, Moment, Running, World, WorldConfig};
