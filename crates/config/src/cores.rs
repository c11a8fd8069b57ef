//! `realtime.cores`: the cores of retarget, control and the driver.

use schema::OutOfBounds;
use serde::{Deserialize, Serialize};

/// The highest core that can be named: CPU_SETSIZE of the C library is 1024.
const CORE_MAX: f64 = 1023.0;

/// `"auto"`, `"free"` or a list of cores.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize, Serialize)]
#[serde(untagged, expecting = "\"auto\", \"free\" or a list of core numbers")]
pub enum Cores {
    /// Others choose them.
    Chosen(Chooser),
    /// These cores.
    List(Vec<u32>),
}

/// The one who chooses the cores.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Chooser {
    /// The daemon: the first isolated core, or the last of 2 to 4, or none.
    Auto,
    /// The kernel.
    Free,
}

impl Cores {
    pub(crate) fn check(&self) -> Result<(), OutOfBounds> {
        let Self::List(list) = self else { return Ok(()) };
        schema::check("cores (how many)", &(list.len() as f64), 1.0, CORE_MAX + 1.0)?;
        list.iter().try_for_each(|core| schema::check("cores (each)", core, 0.0, CORE_MAX))
    }
}

#[cfg(test)]
mod tests {
    use crate::Settings;

    fn with(cores: &str) -> Result<Settings, String> {
        let shipped = include_str!("../../../config/teleop.toml");
        assert!(shipped.contains("cores = \"auto\""), "the shipped settings");
        let text = shipped.replace("cores = \"auto\"", &format!("cores = {cores}"));
        Settings::parse("teleop.toml", &text).map_err(|error| error.to_string())
    }

    #[test]
    fn cores_setting_survives_read_and_write() {
        for cores in ["\"auto\"", "\"free\"", "[2, 3]"] {
            let settings = with(cores).expect(cores);
            let table = toml::Table::try_from(&settings).expect("a table");
            assert_eq!(table["realtime"]["cores"].to_string(), cores);
        }
    }

    #[test]
    fn invalid_cores_setting_is_refused_with_key_and_bound() {
        let refused = |cores: &str| with(cores).expect_err(cores);
        assert!(refused("[]").contains("realtime.cores (how many) = 0 is outside [1, 1024]"), "{}", refused("[]"));
        assert!(refused("[1, 5000]").contains("realtime.cores (each) = 5000 is outside [0, 1023]"));
        for cores in ["\"some\"", "3", "[-1]", "[1.5]", "[\"a\"]"] {
            let text = refused(cores);
            assert!(text.contains("teleop.toml") && text.contains("cores"), "{text}");
        }
        assert!(refused("\"some\"").contains("\"auto\", \"free\" or a list of core numbers"));
    }
}
