//! The figures of a run as text and as JSON.

use rt::Failure;
use serde::Serialize;
use std::fmt::Display;
use std::fs::{File, OpenOptions};
use std::io::Write;
use std::path::{Path, PathBuf};

/// Destination of a run's figures as JSON.
#[derive(Debug)]
pub enum JsonOutput {
    /// None.
    None,
    /// Standard output. The text then goes to standard error.
    Stdout,
    /// A file.
    File(PathBuf, File),
}

impl JsonOutput {
    /// Opens the destination before the run. A file's old content stays until the figures are written. `-` is standard
    /// output.
    pub fn open(path: Option<&Path>) -> Result<Self, Failure> {
        let Some(path) = path else { return Ok(Self::None) };
        if path.as_os_str() == "-" {
            return Ok(Self::Stdout);
        }
        Ok(Self::File(path.to_owned(), open_before_run(path)?))
    }

    /// Prints the text, and writes the figures.
    pub fn write(self, text: &dyn Display, figures: &impl Serialize) -> Result<(), Failure> {
        let json = || serde_json::to_value(figures).map(|value| format!("{value:#}\n"));
        match self {
            Self::None => print(text),
            Self::Stdout => {
                let _ = std::io::stderr().write_all(text.to_string().as_bytes());
                print(&json().unwrap_or_default());
            }
            Self::File(path, mut file) => {
                print(text);
                let mut write = || -> std::io::Result<()> {
                    // A pipe or a terminal has no length.
                    if file.metadata()?.is_file() {
                        file.set_len(0)?;
                    }
                    file.write_all(json()?.as_bytes())
                };
                write().map_err(|cause| Failure::unwritable(&path, &cause))?;
            }
        }
        Ok(())
    }
}

/// Opens a file for writing before a run, so that no run is wasted on an unwritable one. Its old content stays.
pub fn open_before_run(path: &Path) -> Result<File, Failure> {
    let file = OpenOptions::new().write(true).create(true).truncate(false).open(path);
    file.map_err(|cause| Failure::unwritable(path, &cause))
}

/// Prints a text. The reader may have closed the output. The exit code still reports the result.
pub fn print(text: &dyn Display) {
    let _ = std::io::stdout().write_all(text.to_string().as_bytes());
}

#[cfg(test)]
mod tests {
    use super::*;
    use rt::Exit;

    #[test]
    fn old_content_stays_until_figures_replace_it() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("figures.json");
        std::fs::write(&path, [b' '; 1000]).unwrap();
        let output = JsonOutput::open(Some(&path)).unwrap();
        assert_eq!(std::fs::read(&path).unwrap().len(), 1000);
        output.write(&"", &[1, 2]).unwrap();
        assert_eq!(std::fs::read_to_string(&path).unwrap(), "[\n  1,\n  2\n]\n");
    }

    #[test]
    fn unwritable_file_is_refused_by_name() {
        let failure = JsonOutput::open(Some(Path::new("/nowhere/at/all.json"))).expect_err("no folder");
        assert!(failure.exit == Exit::CantCreate && failure.text.starts_with("/nowhere/at/all.json: "), "{failure}");
    }
}
