//! `realtime.cores`: the cores of retarget, control and the driver.

use schema::OutOfBounds;
use serde::de::value::SeqAccessDeserializer;
use serde::de::{Error, SeqAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize, Serializer};

/// The highest core that can be named: CPU_SETSIZE of the C library is 1024.
const CORE_MAX: f64 = 1023.0;

/// `"auto"`, `"free"` or a list of cores.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Cores {
    /// The daemon chooses: the first isolated core, or the last of 2 to 4, or none.
    Auto,
    /// The kernel chooses.
    Free,
    /// These cores.
    List(Vec<u32>),
}

impl Cores {
    pub(crate) fn check(&self) -> Result<(), OutOfBounds> {
        let Self::List(list) = self else { return Ok(()) };
        schema::check("cores (how many)", &(list.len() as f64), 1.0, CORE_MAX + 1.0)?;
        list.iter().try_for_each(|core| schema::check("cores (each)", core, 0.0, CORE_MAX))
    }
}

impl Serialize for Cores {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Self::Auto => serializer.serialize_str("auto"),
            Self::Free => serializer.serialize_str("free"),
            Self::List(list) => list.serialize(serializer),
        }
    }
}

impl<'de> Deserialize<'de> for Cores {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Words;
        impl<'de> Visitor<'de> for Words {
            type Value = Cores;

            fn expecting(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                f.write_str("\"auto\", \"free\" or a list of core numbers")
            }

            fn visit_str<E: Error>(self, text: &str) -> Result<Cores, E> {
                match text {
                    "auto" => Ok(Cores::Auto),
                    "free" => Ok(Cores::Free),
                    _ => Err(E::invalid_value(serde::de::Unexpected::Str(text), &self)),
                }
            }

            fn visit_seq<A: SeqAccess<'de>>(self, sequence: A) -> Result<Cores, A::Error> {
                Vec::deserialize(SeqAccessDeserializer::new(sequence)).map(Cores::List)
            }
        }
        deserializer.deserialize_any(Words)
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
