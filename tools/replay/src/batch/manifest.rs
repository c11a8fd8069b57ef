//! Records which output was made from which input: one line of JSON for each finished file. The line is
//! appended before the file is moved to its place, so every file in place has its line. A run that holds the
//! manifest's lock owns the folder.

use super::failed;
use rt::{Exit, Failure};
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};
use std::collections::HashMap;
use std::fs::{File, OpenOptions, TryLockError};
use std::io::{Read, Write};
use std::path::{Path, PathBuf};
use std::sync::Mutex;

/// Name of the manifest in the output folder.
pub(crate) const FILE: &str = "manifest.jsonl";
/// Size of the largest manifest that is read, bytes: a million files.
const BYTES_MAX: u64 = 1 << 29;

#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
pub(crate) struct Entry {
    pub(crate) output: String,
    pub(crate) input_sha256: String,
    /// SHA-256 of everything else that affects the result.
    pub(crate) options_sha256: String,
    pub(crate) output_sha256: String,
    pub(crate) postures: u64,
}

/// The manifest, open for appending.
pub(crate) struct Manifest {
    path: PathBuf,
    entries: HashMap<String, Vec<Entry>>,
    file: Mutex<File>,
}

impl Manifest {
    /// Locks the folder and reads the manifest. A line that an interruption cut short is ignored.
    pub(crate) fn open(folder: &Path) -> Result<Self, Failure> {
        std::fs::create_dir_all(folder).map_err(failed(folder, "create the folder"))?;
        let path = folder.join(FILE);
        // Opening a pipe would wait for its writer.
        if std::fs::symlink_metadata(&path).is_ok_and(|found| !found.is_file()) {
            return Err(failed(&path, "open")(std::io::Error::other("is not a regular file")));
        }
        let open = OpenOptions::new().create(true).read(true).append(true).open(&path);
        let mut file = open.map_err(failed(&path, "open"))?;
        match file.try_lock() {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => {
                let text =
                    format!("--out {}: another batch is writing there; wait, or give another --out", folder.display());
                return Err(Failure::new(Exit::CantCreate, text));
            }
            Err(TryLockError::Error(source)) => return Err(failed(&path, "lock")(source)),
        }
        let mut text = Vec::new();
        let read = Read::by_ref(&mut file).take(BYTES_MAX).read_to_end(&mut text);
        read.map_err(failed(&path, "read"))?;
        let lines = text.split(|&byte| byte == b'\n');
        let mut entries: HashMap<String, Vec<Entry>> = HashMap::new();
        for entry in lines.filter_map(|line| serde_json::from_slice::<Entry>(line).ok()) {
            entries.entry(entry.output.clone()).or_default().push(entry);
        }
        if text.last().is_some_and(|&byte| byte != b'\n') {
            file.write_all(b"\n").map_err(failed(&path, "write"))?;
        }
        Ok(Self { path, entries, file: Mutex::new(file) })
    }

    /// Returns the entry of an output with this content, if this tool made it.
    pub(crate) fn get(&self, output: &str, output_sha256: &str) -> Option<&Entry> {
        self.entries.get(output)?.iter().rev().find(|entry| entry.output_sha256 == output_sha256)
    }

    pub(crate) fn add(&self, entry: &Entry) -> Result<(), Failure> {
        let line = serde_json::to_string(entry).map_err(std::io::Error::other);
        let write = |line: String| {
            let mut file = self.file.lock().map_err(|_| std::io::Error::other("another job failed here"))?;
            file.write_all((line + "\n").as_bytes())
        };
        line.and_then(write).map_err(failed(&self.path, "write"))
    }
}

pub(crate) fn sha256_file(path: &Path) -> Result<String, Failure> {
    let read = || {
        // Opening a pipe would wait for its writer.
        if !std::fs::metadata(path)?.is_file() {
            return Err(std::io::Error::new(std::io::ErrorKind::InvalidInput, "is not a regular file"));
        }
        let mut file = File::open(path)?;
        let mut hash = Sha256::new();
        let mut buffer = vec![0; 1 << 16];
        loop {
            match file.read(&mut buffer)? {
                0 => break,
                n => hash.update(&buffer[..n]),
            }
        }
        Ok(hash.finalize().iter().map(|byte| format!("{byte:02x}")).collect())
    };
    read().map_err(failed(path, "read"))
}
