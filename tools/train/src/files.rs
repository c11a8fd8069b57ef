//! Reads the robot, and writes files completely or not at all.

use robot::Model;
use rt::{Exit, Failure};
use std::io::{Error, Write};
use std::path::{Path, PathBuf};

pub fn read_model(path: &Path) -> Result<Model, Failure> {
    let (name, text, config) = (path.display().to_string(), read_text(path)?, Failure::with(Exit::Config));
    let urdf = path.parent().unwrap_or(Path::new(".")).join(robot::urdf_file(&name, &text).map_err(config)?);
    Model::from_text(&name, &text, &urdf.display().to_string(), &read_text(&urdf)?).map_err(config)
}

pub(crate) fn read_text(path: &Path) -> Result<String, Failure> {
    std::fs::read_to_string(path).map_err(|error| unreadable(path, &error))
}

/// A file or folder of the user's cannot be read.
pub(crate) fn unreadable(path: &Path, error: &Error) -> Failure {
    Failure::new(Exit::NoInput, rt::unreadable(path, error))
}

/// Writes `bytes` to `path`. The file is either the old one or the new one, never a part.
pub(crate) fn write_at_once(path: &Path, bytes: &[u8]) -> Result<(), Failure> {
    let failed = |error| Failure::unwritable(path, &error);
    if let Some(folder) = path.parent().filter(|folder| !folder.as_os_str().is_empty()) {
        std::fs::create_dir_all(folder).map_err(failed)?;
    }
    let partial = with_suffix(path, ".partial");
    let write = || {
        let mut file = std::fs::File::create(&partial)?;
        file.write_all(bytes)?;
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

/// Writes `<base>.safetensors` and `<base>.toml`. The manifest comes last, because it holds the hash of the other file.
pub fn write_both(base: &Path, tensors: &[u8], manifest: &str) -> Result<(), Failure> {
    write_at_once(&with_suffix(base, ".safetensors"), tensors)?;
    write_at_once(&with_suffix(base, ".toml"), manifest.as_bytes())
}
