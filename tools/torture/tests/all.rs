//! All integration tests of `torture`. They are one program, so that it is linked once.

mod attack;
mod command;
mod motions;
mod stop_times;

use std::path::{Path, PathBuf};
use torture::cli::Changes;
use torture::stages::Subject;

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

/// The shipped robot among the obstacles of the shipped settings.
fn subject(changes: Changes) -> Subject {
    Subject::load(&root().join("config/teleop.toml"), None, changes).unwrap()
}
