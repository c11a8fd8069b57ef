//! Everything that can go wrong, read from `hazards.toml`. Each hazard has an id, the reaction of teleopd, and its bound.
//!
//! At least one test names each id, as in `fn f021_...`. `tests/tidy.rs` fails on an id without one. A hazard
//! that does not apply to teleopd is struck from the list, with the reason. `messages::FAULTS` is another
//! list: the few faults that the daemon reports at run time when it reacts.
//!
//! B is the longest stop, 0.5 s (SAFETY.md). A tick is 1/1500 s. If a machine without real-time scheduling drives
//! a simulated robot, times of the 1500 Hz streams are multiplied by `safety.stale_factor_without_realtime`.

use serde::Deserialize;
use std::sync::LazyLock;

/// One hazard.
#[derive(Debug, Deserialize)]
pub struct Hazard {
    /// `f` and a number of three digits. It never changes and is never reused.
    pub id: String,
    /// Description of the hazard.
    pub what: String,
    /// Reaction of teleopd.
    #[serde(flatten)]
    pub answer: Answer,
}

/// Reaction of teleopd to a hazard.
#[derive(Debug, Deserialize)]
#[serde(untagged)]
pub enum Answer {
    /// A reaction. Every test with the id in its name shows it.
    Does {
        /// The reaction.
        does: String,
        /// Bound on the reaction: a time or a count.
        within: String,
    },
    /// The hazard does not apply.
    Struck {
        /// Reason.
        #[serde(rename = "struck")]
        because: String,
    },
}

/// A group of the list.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Group {
    /// Title.
    pub title: String,
    /// Hazards, in the order of the file.
    pub hazards: Vec<Hazard>,
}

/// The file.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct List {
    group: Vec<Group>,
}

/// Returns the groups, in the order of the file.
pub fn groups() -> &'static [Group] {
    static LIST: LazyLock<List> =
        LazyLock::new(|| toml::from_str(include_str!("../hazards.toml")).unwrap_or_else(|error| panic!("{error}")));
    &LIST.group
}

/// Returns every hazard, in the order of the groups.
pub fn all() -> impl Iterator<Item = &'static Hazard> {
    groups().iter().flat_map(|group| &group.hazards)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hazard_ids_count_up_from_one_without_gap() {
        for (index, hazard) in all().enumerate() {
            assert_eq!(hazard.id, format!("f{:03}", index + 1), "{}", hazard.what);
        }
        assert_eq!(all().count(), 145);
    }

    #[test]
    fn hazard_rows_have_no_empty_text() {
        for hazard in all() {
            let texts = match &hazard.answer {
                Answer::Does { does, within } => vec![&hazard.what, does, within],
                Answer::Struck { because } => vec![&hazard.what, because],
            };
            assert!(texts.iter().all(|text| !text.is_empty() && !text.contains('|')), "{}: {texts:?}", hazard.id);
        }
    }
}
