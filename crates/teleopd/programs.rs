//! The programs beside this one: where they lie, and what a person types to run them.

use crate::exit::{Exit, Failure};
use std::path::{Path, PathBuf};

/// A program of the project.
#[derive(Clone, Copy, Debug)]
pub struct Program {
    /// Its names: in a build folder, and as it is installed.
    names: [&'static str; 2],
    /// How cargo names it.
    cargo: &'static str,
}

pub const TELEOPD: Program = Program { names: ["teleopd", "teleopd"], cargo: "--bin teleopd" };
pub const TELEOPCTL: Program = Program { names: ["teleopctl", "teleopctl"], cargo: "--bin teleopctl" };
pub const REPLAY: Program = Program { names: ["replay", "teleop-replay"], cargo: "-p replay" };
pub const RECORD: Program = Program { names: ["record", "teleop-record"], cargo: "-p record" };

impl Program {
    /// Where it lies; nothing if it is not built.
    pub fn found(&self) -> Option<PathBuf> {
        let own = std::env::current_exe().ok()?;
        let folder = own.parent()?;
        // Tests run from a folder below that of the programs.
        let folders = [Some(folder), folder.parent()].into_iter().flatten();
        let mut places = folders.flat_map(|folder| self.names.map(|name| folder.join(name)));
        places.find(|path| path.is_file())
    }

    /// The same; what to do if it is not there.
    pub fn path(&self) -> Result<PathBuf, Failure> {
        let missing = || {
            let text = format!("the program `{}` is not built (cargo build --release {})", self.names[0], self.cargo);
            Failure::new(Exit::Unavailable, text)
        };
        self.found().ok_or_else(missing)
    }

    /// What a person types to run it: its name where it is installed, else its path from here, else cargo's command.
    pub fn typed(&self) -> String {
        let Some(path) = self.found() else { return format!("cargo run --release {} --", self.cargo) };
        if pipeline::is_installed() {
            return path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        }
        let here = std::env::current_dir().unwrap_or_default();
        path.strip_prefix(&here).unwrap_or(&path).display().to_string()
    }
}

/// ` --run-dir DIR`, where `run_dir` is not where every program looks by itself.
pub fn run_dir_option(run_dir: &Path) -> String {
    if run_dir == pipeline::default_run_dir() { String::new() } else { format!(" --run-dir {}", run_dir.display()) }
}
