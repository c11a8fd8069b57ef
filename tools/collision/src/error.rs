//! What can go wrong with the input.

use std::path::{Path, PathBuf};

/// Why nothing was fitted or checked.
#[derive(Debug, thiserror::Error)]
pub enum CollisionError {
    /// A file could not be read.
    #[error("{}", rt::unreadable(.path, .cause))]
    Read {
        /// Its path.
        path: PathBuf,
        /// The system's words.
        cause: std::io::Error,
    },
    /// A file could not be written.
    #[error("{}", rt::unwritable(.path, .cause))]
    Write {
        /// Its path.
        path: PathBuf,
        /// The system's words.
        cause: std::io::Error,
    },
    /// A file's content makes no sense.
    #[error("{file}: {cause}")]
    Content {
        /// Its path.
        file: String,
        /// What is wrong, with key, value and bound.
        cause: String,
    },
    /// The robot's files were refused.
    #[error(transparent)]
    Robot(#[from] robot::RobotError),
}

impl CollisionError {
    /// A complaint about a file's content.
    pub fn content(file: impl Into<String>, cause: impl Into<String>) -> Self {
        Self::Content { file: file.into(), cause: cause.into() }
    }
}

/// Reads a whole file.
pub fn read(path: &Path) -> Result<Vec<u8>, CollisionError> {
    std::fs::read(path).map_err(|cause| CollisionError::Read { path: path.to_path_buf(), cause })
}

/// Reads a whole text file.
pub fn read_text(path: &Path) -> Result<String, CollisionError> {
    std::fs::read_to_string(path).map_err(|cause| CollisionError::Read { path: path.to_path_buf(), cause })
}
