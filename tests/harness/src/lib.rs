//! Real processes of an instance in a temporary folder, started, engaged and ended. A tool gets every failure as
//! an error with an exit code. A test uses [`Rig`], which panics instead.
//!
//! - [`Harness`]: the folder, the settings, the processes.
//! - [`Operator`]: brings the instance to a state in which it can be engaged, engages and holds.
//! - [`roles`]: the program that uses the harness, run again as another process.
//! - [`Rig`], [`OperatorSession`], [`StateObserver`]: the same for a test.
//! - [`wait_until`]: a test's wait for a condition. [`in_real_time`]: runs a test again if this machine paused.
//!   [`assert_always`]: a failure that no pause excuses.
//! - [`Cable`]: a network namespace.
//! - [`python`]: virtual environments of Python.
//! - [`user`]: a thread with the credentials of another user.

mod cable;
mod observer;
mod operator;
mod pause;
mod python;
mod rig;
pub mod roles;
mod running;
mod settings;
pub mod user;

pub use cable::{Cable, shell};
pub use observer::StateObserver;
pub use operator::{Look, Operator};
pub use pause::{assert_always, in_real_time};
pub use python::python;
pub use rig::{DRIVER, OperatorSession, Rig, SHORT_HOLD, assert_no_violations, interrupt, modes};
pub use running::{Harness, publisher};
pub use settings::write as write_settings;
pub use wait::{Pace, SOON, holds_for, soon, wait_until, within};

use std::path::{Path, PathBuf};
use std::process::Output;

/// Returns the root of the source tree.
pub fn repository() -> PathBuf {
    // This package is tests/harness.
    Path::new(env!("CARGO_MANIFEST_DIR")).ancestors().nth(2).expect("the root").to_path_buf()
}

/// Returns the settings file of the source tree.
pub fn config() -> PathBuf {
    repository().join("config/teleop.toml")
}

/// Returns what a program wrote to its standard output.
pub fn stdout(output: &Output) -> String {
    String::from_utf8_lossy(&output.stdout).into_owned()
}

/// Returns what a program wrote to its standard error.
pub fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}
