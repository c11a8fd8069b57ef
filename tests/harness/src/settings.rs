//! A copy of the settings with changes.

use rt::{Exit, Failure};
use std::path::Path;
use toml::{Table, Value};

/// Files that the settings name relative to their own folder, and true if the file is required.
const FILES: [(&str, &str, bool); 4] = [
    ("robot", "file", true),
    ("weights", "file", true),
    ("retarget", "prediction", false),
    ("ingest", "lifter", false),
];

/// Writes the settings `config` with `changes` to `copy`. The changes are TOML, such as `realtime.policy = "other"`.
pub fn write(config: &Path, changes: &str, copy: &Path) -> Result<(), Failure> {
    let refuse = |cause: &dyn std::fmt::Display| Failure::new(Exit::Config, format!("{}: {cause}", config.display()));
    let text = std::fs::read_to_string(config).map_err(|error| refuse(&error))?;
    let mut settings: Table = toml::from_str(&text).map_err(|error| refuse(&error))?;
    let folder = config.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let folder = folder.canonicalize().map_err(|error| refuse(&error))?;
    for (section, key, required) in FILES {
        let file = settings.get_mut(section).and_then(|section| section.get_mut(key));
        match file {
            // An empty name means no file.
            Some(Value::String(file)) if !file.is_empty() => *file = folder.join(&*file).display().to_string(),
            _ if required => return Err(refuse(&format!("{section}.{key} is missing"))),
            _ => {}
        }
    }
    let changes: Table = toml::from_str(changes).map_err(|error| refuse(&error))?;
    for (name, changed) in changes {
        let section = settings.get_mut(&name).and_then(Value::as_table_mut);
        let (Some(section), Value::Table(changed)) = (section, changed) else {
            return Err(refuse(&format!("[{name}] is missing")));
        };
        section.extend(changed);
    }
    std::fs::write(copy, settings.to_string()).map_err(|error| Failure::unwritable(copy, &error))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn incomplete_settings_file_is_refused_by_file_and_key() {
        let folder = tempfile::tempdir().unwrap();
        let (file, copy) = (folder.path().join("wrong.toml"), folder.path().join("copy"));
        std::fs::write(&file, "[robot]\n").unwrap();
        let failure = write(&file, "", &copy).expect_err("no file");
        assert!(failure.text.contains("wrong.toml: robot.file"), "{failure}");
        assert_eq!(failure.exit, Exit::Config);
        let failure = write(&crate::config(), "nothing.here = 1", &copy).expect_err("no section");
        assert!(failure.text.contains("[nothing] is missing"), "{failure}");
    }
}
