//! Composes the stages once, for the daemon, for offline replay and for simulation. It holds the settings and the
//! control tick of engagement, whole-body control and gate. It also runs all stages in one thread with virtual
//! time.

mod offline;
mod stages;
mod tamper;
mod world;

pub use offline::{Offline, OfflineEnd, OfflineReport, Row, Watch};
pub use stages::{control_config, input_config, retarget_config, sim_config};
pub use tamper::{Tamper, Untampered};
pub use world::{Links, Moment, Running, World, WorldConfig};
