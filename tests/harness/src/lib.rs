//! Real processes of an instance in a temporary folder, started, engaged and ended. A tool gets every failure as
//! an error with an exit code. A test uses [`Rig`], which panics instead.
//!
//! - [`Harness`]: the folder, the settings, the processes.
//! - [`Operator`]: brings the instance to a state in which it can be engaged, engages and holds.
//! - [`roles`]: the program that uses the harness, run again as another process.
//! - [`Rig`], [`OperatorSession`], [`StateObserver`]: the same for a test.
//! - [`Cable`]: a network namespace.
//! - [`python`]: virtual environments of Python.
//! - [`user`]: a thread with the credentials of another user.

mod cable;
mod observer;
mod operator;
mod python;
mod rig;
pub mod roles;
mod running;
mod settings;
pub mod user;

pub use cable::{Cable, shell};
pub use observer::StateObserver;
pub use operator::{Look, Operator};
pub use python::python;
pub use rig::{OperatorSession, Rig, assert_no_violations, interrupt, modes};
pub use running::{Harness, publisher};
pub use settings::write as write_settings;

use rt::{Exit, Failure};
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Longest time for any expected event. Only a hang comes near it.
pub const SOON: Duration = Duration::from_secs(25);

/// Returns the root of the source tree.
pub fn repository() -> PathBuf {
    // This package is tests/harness.
    Path::new(env!("CARGO_MANIFEST_DIR")).ancestors().nth(2).expect("the root").to_path_buf()
}

/// Returns the settings file of the source tree.
pub fn config() -> PathBuf {
    repository().join("config/teleop.toml")
}

/// Parses the command line. An invalid one ends the program with EX_USAGE of sysexits(3).
pub fn parse<C: clap::Parser>() -> C {
    C::try_parse().unwrap_or_else(|error| {
        // Help and version also come this way. They are not errors.
        let _ = error.print();
        std::process::exit(if error.use_stderr() { Exit::Usage as i32 } else { 0 })
    })
}

/// The failure of a run that a signal ended.
pub fn interrupted() -> Failure {
    Failure::new(Exit::Interrupted, "interrupted; the robot was stopped")
}

/// Opens a file before a run, so that an unwritable file is reported then. Its content stays.
///
/// # Errors
/// Returns an error with EX_CANTCREAT that names the file.
pub fn check_writable(path: &Path) -> Result<(), Failure> {
    std::fs::OpenOptions::new()
        .append(true)
        .create(true)
        .open(path)
        .map_err(|error| Failure::unwritable(path, &error))?;
    Ok(())
}

/// Writes the figures of a run.
///
/// # Errors
/// Returns an error with EX_CANTCREAT that names the file.
pub fn write_json(path: &Path, figures: &Value) -> Result<(), Failure> {
    std::fs::write(path, format!("{figures:#}\n")).map_err(|error| Failure::unwritable(path, &error))
}
