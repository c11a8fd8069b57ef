//! Texts from files that other users may have written.

use super::library::invalid;
use rt::{Exit, Failure};
use std::fmt::Display;
use std::fs::File;
use std::io::Read;
use std::path::Path;

/// Size of the largest text that is read, bytes. HumanML3D's 45,000 captions take 3 MB.
const BYTES_MAX: u64 = 64 << 20;

pub fn read(path: &Path) -> Result<String, Failure> {
    regular(path)?;
    let mut text = Vec::new();
    // A file may grow while it is read.
    File::open(path)
        .and_then(|open| open.take(BYTES_MAX + 1).read_to_end(&mut text))
        .map_err(|error| Failure::new(Exit::NoInput, rt::unreadable(path, &error)))?;
    if text.len() as u64 > BYTES_MAX {
        return Err(invalid(&path.display().to_string(), &format!(": longer than {BYTES_MAX} bytes; split it")));
    }
    String::from_utf8(text).map_err(|error| unreadable(path, &error.utf8_error()))
}

/// Rejects a file that is not regular, before it is opened. Opening a pipe would wait for its writer.
pub(crate) fn regular(path: &Path) -> Result<(), Failure> {
    match std::fs::metadata(path) {
        Ok(found) if found.is_file() => Ok(()),
        Ok(_) => Err(unreadable(path, &"is not a regular file; give a file")),
        Err(error) => Err(Failure::new(Exit::NoInput, rt::unreadable(path, &error))),
    }
}

pub(crate) fn unreadable(path: &Path, cause: &dyn Display) -> Failure {
    Failure::new(Exit::NoInput, format!("{}: {cause}", path.display()))
}

/// Makes text safe for a terminal: every control character becomes U+FFFD.
pub fn shown(text: &str) -> String {
    text.chars().map(|c| if c.is_control() { char::REPLACEMENT_CHARACTER } else { c }).collect()
}

/// Returns JSON without control characters except line ends. serde_json leaves some control characters unescaped.
pub fn escaped(json: &str) -> String {
    let escaped = |c: char| c.is_control() && c != '\n';
    json.chars().map(|c| if escaped(c) { format!("\\u{:04x}", u32::from(c)) } else { c.to_string() }).collect()
}
