//! A block's own copy of the settings.

use crate::blocks::Kind;
use crate::cli::{Pin, Policy};
use crate::error::LatencyError;
use messages::TICK_HZ;
use std::path::{Path, PathBuf};
use toml::{Table, Value};

/// Driver grace of the polled variant. Two half ticks would be 667 us. This is the longest value that the
/// settings allow, and favours polling by 7 us.
const POLLED_DRIVER_GRACE_US: f64 = 660.0;

/// Changes that the command line makes to the settings.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Changes {
    /// `realtime.policy`.
    pub policy: Option<Policy>,
    /// `realtime.cores`.
    pub pin: Option<Pin>,
}

/// Writes the settings `config` with `changes` to `copy`, as a block of `kind` needs them. In the polled
/// variant every process runs half a tick after its predecessor. That is the mean wait of timers that are not
/// synchronised.
///
/// # Errors
/// Returns an error if the file cannot be read, is no settings file, or the copy cannot be written.
pub fn write(config: &Path, changes: &Changes, kind: Kind, copy: &Path) -> Result<(), LatencyError> {
    let refuse = |cause: String| LatencyError::Settings { file: config.to_path_buf(), cause };
    let text = std::fs::read_to_string(config).map_err(|error| refuse(error.to_string()))?;
    let mut table: Table = toml::from_str(&text).map_err(|error| refuse(error.to_string()))?;
    let folder = config.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let folder = folder.canonicalize().map_err(|error| refuse(error.to_string()))?;
    for name in ["robot", "weights"] {
        let path = absolute(&folder, &table, name, "file").ok_or_else(|| refuse(format!("{name}.file is missing")))?;
        set(&mut table, name, "file", Value::String(path)).map_err(&refuse)?;
    }
    // An empty name means no file.
    if let Some(path) = absolute(&folder, &table, "retarget", "prediction") {
        set(&mut table, "retarget", "prediction", Value::String(path)).map_err(&refuse)?;
    }
    let hand_off = if kind == Kind::Polled { "polled" } else { "events" };
    set(&mut table, "realtime", "hand_off", Value::String(hand_off.into())).map_err(&refuse)?;
    if kind == Kind::Polled {
        let half_us = (5e5 / TICK_HZ as f64).floor();
        set(&mut table, "control", "grace_us", Value::Float(half_us)).map_err(&refuse)?;
        set(&mut table, "driver", "grace_us", Value::Float(POLLED_DRIVER_GRACE_US)).map_err(&refuse)?;
    }
    if let Some(policy) = changes.policy {
        let name = if policy == Policy::Fifo { "fifo" } else { "other" };
        set(&mut table, "realtime", "policy", Value::String(name.into())).map_err(&refuse)?;
    }
    if let Some(pin) = &changes.pin {
        let cores = match pin {
            Pin::Free => Value::String("free".into()),
            Pin::Cores(cores) => Value::Array(cores.iter().map(|&core| Value::Integer(core as i64)).collect()),
        };
        set(&mut table, "realtime", "cores", cores).map_err(&refuse)?;
    }
    std::fs::write(copy, table.to_string()).map_err(|error| LatencyError::write(copy, error))
}

fn absolute(folder: &Path, table: &Table, name: &str, key: &str) -> Option<String> {
    let file = table.get(name)?.get(key)?.as_str().filter(|file| !file.is_empty())?;
    let path: PathBuf = folder.join(file);
    path.to_str().map(str::to_owned)
}

fn set(table: &mut Table, name: &str, key: &str, value: Value) -> Result<(), String> {
    let section = table.get_mut(name).and_then(Value::as_table_mut).ok_or_else(|| format!("[{name}] is missing"))?;
    section.insert(key.to_owned(), value);
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use config::Overrides;

    fn config() -> PathBuf {
        Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/teleop.toml")
    }

    fn loaded(changes: &Changes, kind: Kind) -> config::Settings {
        let folder = tempfile::tempdir().unwrap();
        let copy = folder.path().join("teleop.toml");
        write(&config(), changes, kind, &copy).expect("the settings of this tree");
        config::load(&copy, Overrides::default()).expect("the copy is a settings file").settings
    }

    #[test]
    fn settings_copy_differs_only_as_its_block_needs() {
        let original = config::load(&config(), Overrides::default()).unwrap().settings;
        let mut events = loaded(&Changes::default(), Kind::Events);
        events.robot = original.robot.clone();
        events.weights = original.weights.clone();
        events.retarget.prediction = original.retarget.prediction.clone();
        assert_eq!(events, original);
        let polled = loaded(&Changes::default(), Kind::Polled);
        assert_ne!(polled.realtime, original.realtime);
        assert_eq!((polled.control.grace_us, polled.driver.grace_us), (333.0, 660.0));
        assert_eq!(polled.safety, original.safety);
    }

    #[test]
    fn policy_and_cores_of_the_command_line_override_the_file() {
        let free = Changes { policy: Some(Policy::Other), pin: Some(Pin::Free) };
        assert_eq!(loaded(&free, Kind::Events).realtime.policy, config::Policy::Other);
        let pinned = Changes { policy: Some(Policy::Fifo), pin: Some(Pin::Cores(vec![0])) };
        let pinned = loaded(&pinned, Kind::Events).realtime;
        assert_eq!(pinned.policy, config::Policy::Fifo);
        assert_ne!(pinned.cores, loaded(&free, Kind::Events).realtime.cores);
    }

    #[test]
    fn incomplete_settings_file_is_refused_by_file_and_key() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("wrong.toml");
        std::fs::write(&file, "[robot]\n").unwrap();
        let error = write(&file, &Changes::default(), Kind::Events, &folder.path().join("copy")).expect_err("no file");
        assert!(error.to_string().contains("wrong.toml: robot.file"), "{error}");
        assert_eq!(error.exit(), 78);
    }
}
