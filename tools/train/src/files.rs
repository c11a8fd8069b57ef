//! Reads the robot, and writes files completely or not at all.

use crate::error::TrainError;
use robot::Model;
use std::path::{Path, PathBuf};

pub fn read_model(path: &Path) -> Result<Model, TrainError> {
    let name = path.display().to_string();
    let text = read_text(path)?;
    let urdf = path.parent().unwrap_or(Path::new(".")).join(robot::urdf_file(&name, &text)?);
    Ok(Model::from_text(&name, &text, &urdf.display().to_string(), &read_text(&urdf)?)?)
}

pub(crate) fn read_text(path: &Path) -> Result<String, TrainError> {
    std::fs::read_to_string(path).map_err(|source| TrainError::File {
        path: path.to_path_buf(),
        action: "read",
        source,
    })
}

/// Writes `bytes` to `path`. The file is either the old one or the new one, never a part.
pub(crate) fn write_at_once(path: &Path, bytes: &[u8]) -> Result<(), TrainError> {
    let failed = |source| TrainError::File { path: path.to_path_buf(), action: "write", source };
    if let Some(folder) = path.parent().filter(|folder| !folder.as_os_str().is_empty()) {
        std::fs::create_dir_all(folder).map_err(failed)?;
    }
    let partial = with_suffix(path, ".partial");
    let write = || {
        let mut file = std::fs::File::create(&partial)?;
        std::io::Write::write_all(&mut file, bytes)?;
        // If the rename came before the contents are on disk, a power cut could leave an empty file under the
        // final name.
        file.sync_all()?;
        std::fs::rename(&partial, path)
    };
    write().map_err(failed)
}

/// Returns `base` with an extension appended. The name itself may contain a dot.
pub(crate) fn with_suffix(base: &Path, suffix: &str) -> PathBuf {
    let mut name = base.as_os_str().to_owned();
    name.push(suffix);
    PathBuf::from(name)
}

/// Writes `<base>.safetensors` and `<base>.toml`. The manifest comes last, because it holds the hash of the
/// other file.
pub fn write_both(base: &Path, tensors: &[u8], manifest: &str) -> Result<(), TrainError> {
    write_at_once(&with_suffix(base, ".safetensors"), tensors)?;
    write_at_once(&with_suffix(base, ".toml"), manifest.as_bytes())
}
