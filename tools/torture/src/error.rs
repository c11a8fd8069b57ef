//! Errors that keep a run from beginning or ending.

use std::fmt::Display;
use std::path::Path;

/// An error that keeps a run from beginning or ending: an exit code of sysexits(3), and a text that names file,
/// option, value and bound.
#[derive(Debug)]
pub struct Failed(pub u8, pub String);

const EX_USAGE: u8 = 64;
const EX_NOINPUT: u8 = 66;
const EX_CANTCREAT: u8 = 73;
const EX_CONFIG: u8 = 78;

impl Failed {
    /// An option is out of its bounds.
    pub fn option(option: &str, value: impl Display, bound: impl Display) -> Self {
        Self(EX_USAGE, format!("{option} = {value}: must be {bound}"))
    }

    /// A stage, or torture itself, rejects the robot or the settings of a file.
    pub(crate) fn rejected(file: &Path, cause: impl Display) -> Self {
        Self(EX_CONFIG, format!("{}: {cause}", file.display()))
    }

    /// A folder has no motion files.
    pub(crate) fn no_motions(folder: &Path) -> Self {
        Self(EX_NOINPUT, format!("{}: no motion files (.bvh, .npy, .npz) in it", folder.display()))
    }

    /// A file cannot be written.
    pub(crate) fn unwritable(file: &Path, cause: &std::io::Error) -> Self {
        Self(EX_CANTCREAT, format!("{}: {cause}", file.display()))
    }
}

impl From<config::ConfigError> for Failed {
    fn from(error: config::ConfigError) -> Self {
        Self(EX_CONFIG, error.to_string())
    }
}

impl From<motion::MotionError> for Failed {
    fn from(error: motion::MotionError) -> Self {
        Self(EX_NOINPUT, error.to_string())
    }
}
