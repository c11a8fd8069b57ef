//! Virtual environments of Python for tests. They are made once, in a build folder.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::Mutex;

/// Makes the virtual environment `folder` if it is not there, and installs packages into it with these words of `pip
/// install`. Returns its interpreter. Threads of one program take turns, and each package is installed once by a program.
pub fn python(folder: &Path, packages: &[&str]) -> Result<PathBuf, String> {
    static INSTALLED: Mutex<Vec<(PathBuf, String)>> = Mutex::new(Vec::new());
    let mut installed = INSTALLED.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
    let python = folder.join("bin/python");
    let run = |command: &mut Command| match command.output() {
        Ok(done) if done.status.success() => Ok(()),
        Ok(done) => Err(format!("{command:?}: {}", String::from_utf8_lossy(&done.stderr).trim())),
        Err(error) => Err(format!("{command:?}: {error}")),
    };
    if !python.exists() {
        run(Command::new("python3").args(["-m", "venv"]).arg(folder))?;
    }
    let pip = ["-m", "pip", "install", "--quiet", "--retries", "1", "--timeout", "10"];
    let new = |package: &&&str| !installed.iter().any(|(place, name)| place == folder && name == *package);
    let missing: Vec<&str> = packages.iter().filter(new).copied().collect();
    if !missing.is_empty() {
        run(Command::new(&python).args(pip).args(&missing))?;
        installed.extend(missing.into_iter().map(|package| (folder.to_path_buf(), package.to_owned())));
    }
    Ok(python)
}
