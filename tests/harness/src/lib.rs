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
pub use rig::{DRIVER, OperatorSession, Rig, SHORT_HOLD, assert_no_violations, interrupt, modes, signal};
pub use running::{Harness, publisher};
pub use settings::write as write_settings;
pub use wait::{Pace, SOON, holds_for, soon, wait_until, within, within_by};

use std::ops::{Deref, DerefMut};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};

/// Returns the root of the source tree.
pub fn repository() -> PathBuf {
    // This package is tests/harness.
    Path::new(env!("CARGO_MANIFEST_DIR")).ancestors().nth(2).expect("the root").to_path_buf()
}

/// Returns the settings file of the source tree.
pub fn config() -> PathBuf {
    repository().join("config/teleop.toml")
}

/// A process that is killed when the test ends.
pub struct Killed(pub Child);

impl Deref for Killed {
    type Target = Child;

    fn deref(&self) -> &Child {
        &self.0
    }
}

impl DerefMut for Killed {
    fn deref_mut(&mut self) -> &mut Child {
        &mut self.0
    }
}

impl Drop for Killed {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// Runs a program without input. Checks its exit code, and that its standard error contains all parts. Returns that text.
#[track_caller]
pub fn assert_ends(command: &mut Command, code: i32, parts: &[&str]) -> String {
    let output = command.stdin(Stdio::null()).output().unwrap_or_else(|error| panic!("{command:?}: {error}"));
    let printed = stderr(&output);
    assert_eq!(output.status.code(), Some(code), "{command:?}: {printed}");
    for part in parts {
        assert!(printed.contains(part), "{command:?}: {part:?} is missing: {printed}");
    }
    printed
}

/// Returns what a program wrote to its standard output.
pub fn stdout(output: &Output) -> String {
    String::from_utf8_lossy(&output.stdout).into_owned()
}

/// Returns what a program wrote to its standard error.
pub fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}
