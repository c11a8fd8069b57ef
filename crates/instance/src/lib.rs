//! Places of an instance of teleopd: its folder with sockets, shared-memory domains and files, and the paths that programs
//! use by default.

mod installed;
mod instance;
mod names;

pub use installed::{default_config, default_motions, default_robot, default_run_dir, is_installed};
pub use instance::{DEFAULT_RUN_DIR, Instance, write_anew};
pub use names::{read_names, write_names};
