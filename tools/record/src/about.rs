//! Metadata of a recording: the settings, robot and weights that it was made with.

use config::{Loaded, Overrides};
use std::collections::BTreeMap;
use std::path::Path;

/// Size of the largest file that is attached, bytes. For larger ones only the hash is kept.
const ATTACHED_BYTES_MAX: u64 = 1 << 20;

messages::named! {
    /// How a recording was made.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub enum Origin {
        /// The recorder read them from a running instance.
        Live => "live",
        /// The stages ran in virtual time. The file has every message of every tick.
        Offline => "offline",
    }
}

pub type Files = Vec<(String, Vec<u8>)>;

/// Returns the table of metadata, and the files to attach: settings, robot, manifest of the weights. Files that
/// can no longer be read are left out.
pub fn about(loaded: &Loaded, overrides: &Overrides, origin: Origin) -> (BTreeMap<String, String>, Files) {
    let mut about = BTreeMap::from([
        ("version".to_owned(), env!("CARGO_PKG_VERSION").to_owned()),
        ("origin".to_owned(), origin.name().to_owned()),
        ("config_hash".to_owned(), format!("{:016x}", loaded.hash)),
        ("robot".to_owned(), loaded.model.name.clone()),
        ("robot_hash".to_owned(), format!("{:016x}", loaded.model.hash)),
        ("tick_hz".to_owned(), messages::TICK_HZ.to_string()),
        ("engage_without_realtime".to_owned(), overrides.engage_without_realtime.to_string()),
        ("interface".to_owned(), loaded.settings.interface().name().to_owned()),
    ]);
    let mut files = Vec::new();
    for path in &loaded.files {
        let name = path.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned());
        let Ok(bytes) = std::fs::read(path) else { continue };
        about.insert(format!("sha256 {name}"), retarget::sha256_hex(&bytes));
        if bytes.len() as u64 <= ATTACHED_BYTES_MAX && path != Path::new("") {
            files.push((name, bytes));
        }
    }
    (about, files)
}
