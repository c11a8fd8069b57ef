//! Errors of the input.

use std::path::{Path, PathBuf};

#[derive(Debug, thiserror::Error)]
pub enum CollisionError {
    #[error("{}", rt::unreadable(.path, .cause))]
    Read { path: PathBuf, cause: std::io::Error },
    #[error("{}", rt::unwritable(.path, .cause))]
    Write { path: PathBuf, cause: std::io::Error },
    #[error("{file}: {cause}")]
    Content { file: String, cause: String },
    #[error(transparent)]
    Robot(#[from] robot::RobotError),
    #[error(transparent)]
    Links(#[from] plant::PlantError),
}

impl CollisionError {
    pub fn content(file: impl Into<String>, cause: impl Into<String>) -> Self {
        Self::Content { file: file.into(), cause: cause.into() }
    }
}

pub fn read(path: &Path) -> Result<Vec<u8>, CollisionError> {
    std::fs::read(path).map_err(|cause| CollisionError::Read { path: path.to_path_buf(), cause })
}

pub fn read_text(path: &Path) -> Result<String, CollisionError> {
    std::fs::read_to_string(path).map_err(|cause| CollisionError::Read { path: path.to_path_buf(), cause })
}
