//! The folder of a run. A temporary one is removed at the end.

use std::path::{Path, PathBuf};

pub struct Folder {
    /// Its path. The folder need not exist.
    pub path: PathBuf,
    /// True if no folder was chosen.
    pub temporary: bool,
}

impl Folder {
    /// Returns the chosen folder. Without one, names a temporary folder for this command.
    pub fn new(chosen: Option<&Path>, command: &str) -> Self {
        let named = || std::env::temp_dir().join(format!("teleopd-{command}-{}", std::process::id()));
        Self { path: chosen.map_or_else(named, Path::to_path_buf), temporary: chosen.is_none() }
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        if self.temporary {
            let _ = std::fs::remove_dir_all(&self.path);
        }
    }
}
