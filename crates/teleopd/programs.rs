//! The other programs of the project: where they are, and the command that a person types to run them.

use rt::{Exit, Failure};
use std::path::{Path, PathBuf};

#[derive(Clone, Copy, Debug)]
pub struct Program {
    /// Name in a build folder, and name after installation.
    names: [&'static str; 2],
    /// Arguments with which cargo builds or runs it.
    cargo: &'static str,
}

pub const TELEOPD: Program = Program { names: ["teleopd", "teleopd"], cargo: "--bin teleopd" };
pub const TELEOPCTL: Program = Program { names: ["teleopctl", "teleopctl"], cargo: "--bin teleopctl" };
pub const REPLAY: Program = Program { names: ["replay", "teleop-replay"], cargo: "-p replay" };
pub const ROS2: Program = Program { names: ["teleopd-ros2", "teleopd-ros2"], cargo: "-p ros2" };
pub const RECORD: Program = Program { names: ["record", "teleop-record"], cargo: "-p record" };
pub const COLLISION: Program = Program { names: ["collision", "teleop-collision"], cargo: "-p collision" };

impl Program {
    pub const fn name(&self) -> &'static str {
        self.names[0]
    }

    pub fn found(&self) -> Option<PathBuf> {
        let own = std::env::current_exe().ok()?;
        let folder = own.parent()?;
        // Tests run from a folder below the programs' folder.
        let folders = [Some(folder), folder.parent()].into_iter().flatten();
        let mut places = folders.flat_map(|folder| self.names.map(|name| folder.join(name)));
        places.find(|path| path.is_file())
    }

    /// Returns the program's path. The error says how to build a missing program.
    pub fn path(&self) -> Result<PathBuf, Failure> {
        let missing = || {
            let text = format!("the program `{}` is not built (cargo build --release {})", self.names[0], self.cargo);
            Failure::new(Exit::Unavailable, text)
        };
        self.found().ok_or_else(missing)
    }

    /// Returns the command that a person types: its name if installed, else its path from here, else cargo's command.
    pub fn typed(&self) -> String {
        let Some(path) = self.found() else { return format!("cargo run --release {} --", self.cargo) };
        if instance::is_installed() {
            return path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        }
        let here = std::env::current_dir().unwrap_or_default();
        path.strip_prefix(&here).unwrap_or(&path).display().to_string()
    }
}

/// Returns ` --run-dir DIR`, or nothing if `run_dir` is the default of every program.
pub fn run_dir_option(run_dir: &Path) -> String {
    if run_dir == instance::default_run_dir() { String::new() } else { format!(" --run-dir {}", run_dir.display()) }
}
