//! The robot that a command line chooses, in place of the one that the settings name.

use crate::ConfigError;
use crate::load::weight_files;
use crate::settings::Settings;
use retarget::Method;
use std::path::{Path, PathBuf};

/// Extension of a robot file.
const ROBOT: &str = ".toml";
/// Ends of other files beside robot files.
const NO_ROBOT: &str = ".look.toml";

/// Value of `--robot`: the name of a robot, or its file. A value with a slash or the extension .toml is a file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RobotChoice(String);

// `clap` reads values of such types.
impl From<&str> for RobotChoice {
    fn from(text: &str) -> Self {
        Self(text.to_owned())
    }
}

impl RobotChoice {
    /// The value as typed.
    pub fn typed(&self) -> &str {
        &self.0
    }

    /// Name of the robot and of its weights: the file's name without extension.
    pub fn name(&self) -> String {
        let file = Path::new(&self.0).file_name().unwrap_or_default().to_string_lossy();
        file.strip_suffix(ROBOT).unwrap_or(&file).to_owned()
    }

    fn is_file(&self) -> bool {
        // A URDF is no robot file, and the error says so.
        self.0.contains('/') || [ROBOT, ".urdf", ".xacro"].iter().any(|extension| self.0.ends_with(extension))
    }

    /// Returns the robot file. A named robot has its file in the folder of `other`, the file of another robot.
    pub fn file_beside(&self, other: &Path) -> Result<PathBuf, ConfigError> {
        if self.is_file() {
            return Ok(PathBuf::from(&self.0));
        }
        let file = other.with_file_name(format!("{}{ROBOT}", self.0));
        if file.is_file() {
            return Ok(file);
        }
        let folder = match other.parent() {
            Some(folder) if folder != Path::new("") => folder,
            _ => Path::new("."),
        };
        let (name, folder, names) = (self.0.clone(), folder.display().to_string(), names(folder).join(", "));
        let known = if names.is_empty() { "none".to_owned() } else { names };
        Err(ConfigError::UnknownRobot { name, folder, known })
    }

    /// Returns the weights, as a path without extension. They have the robot's name and lie in the folder of `others`,
    /// the weights of another robot. If there are none, `others` is returned: a robot with the same arms has the same
    /// weights.
    pub fn weights_beside(&self, others: &Path) -> PathBuf {
        let own = self.own_weights(others);
        if weight_files(&own)[0].exists() { own } else { others.to_path_buf() }
    }

    /// Returns the robot file of a program that reads no settings.
    pub fn shipped_file(&self) -> Result<PathBuf, ConfigError> {
        let [robot, _] = instance::default_robot();
        self.file_beside(&robot)
    }

    /// Returns the weights for a program that reads no settings, as a path without extension.
    pub fn shipped_weights(&self) -> PathBuf {
        let [_, weights] = instance::default_robot();
        self.weights_beside(&weights)
    }

    fn own_weights(&self, others: &Path) -> PathBuf {
        others.with_file_name(self.name())
    }

    /// Puts the robot and its weights into `settings`, which were read from the file `config`.
    pub(crate) fn apply(&self, config: &Path, settings: &mut Settings) -> Result<(), ConfigError> {
        let folder = config.parent().unwrap_or(Path::new("."));
        let own = PathBuf::from(&settings.robot.file);
        let file = self.file_beside(&folder.join(&own))?;
        // The settings' paths are relative to their file, and that of a command line to the current folder.
        let file = if self.is_file() {
            std::path::absolute(&file).unwrap_or(file)
        } else {
            own.with_file_name(file.file_name().unwrap_or_default())
        };
        settings.robot.file = file.to_string_lossy().into_owned();
        let others = PathBuf::from(&settings.weights.file);
        // Without a network nothing is lost if there are no weights. The settings' own would be refused.
        let has_own = weight_files(&folder.join(self.own_weights(&others)))[0].exists();
        if has_own || settings.retarget.method == Method::ClosedForm {
            settings.weights.file = self.own_weights(&others).to_string_lossy().into_owned();
        }
        Ok(())
    }
}

/// Returns the names of the robots in a folder, in alphabetical order.
fn names(folder: &Path) -> Vec<String> {
    let files = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let name = |file: std::fs::DirEntry| {
        let name = file.file_name().into_string().ok().filter(|name| !name.ends_with(NO_ROBOT))?;
        name.strip_suffix(ROBOT).map(str::to_owned)
    };
    let mut names: Vec<_> = files.filter_map(name).collect();
    names.sort();
    names
}
