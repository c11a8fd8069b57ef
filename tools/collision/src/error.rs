//! Errors of the input.

use std::path::{Path, PathBuf};

/// An error that prevents fitting or checking.
#[derive(Debug, thiserror::Error)]
pub enum CollisionError {
    /// A file could not be read.
    #[error("{}", rt::unreadable(.path, .cause))]
    Read {
        /// Its path.
        path: PathBuf,
        /// The system's error.
        cause: std::io::Error,
    },
    /// A file could not be written.
    #[error("{}", rt::unwritable(.path, .cause))]
    Write {
        /// Its path.
        path: PathBuf,
        /// The system's error.
        cause: std::io::Error,
    },
    /// A file's content is invalid.
    #[error("{file}: {cause}")]
    Content {
        /// Its path.
        file: String,
        /// The problem, with key, value and bound.
        cause: String,
    },
    /// The robot's files are invalid.
    #[error(transparent)]
    Robot(#[from] robot::RobotError),
}

impl CollisionError {
    /// Creates the error of a file's content.
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
