//! Everything that can go wrong, in one list. Each hazard has an id, the reaction of teleopd, and its bound.
//!
//! At least one test names each id, as in `fn f021_...`. `tests/tidy.rs` fails on an id without one. A hazard
//! that does not apply to teleopd is struck from the list here, with the reason. `messages::FAULTS` is another
//! list: the few faults that the daemon reports at run time when it reacts.
//!
//! B is the longest stop, 0.5 s (SAFETY.md). A tick is 1/1500 s. If a machine without real-time scheduling drives
//! a simulated robot, times of the 1500 Hz streams are multiplied by `safety.stale_factor_without_realtime`.

mod input;
mod robot;
mod system;

/// One hazard.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Hazard {
    /// `f` and a number of three digits. It never changes and is never reused.
    pub id: &'static str,
    /// Description of the hazard.
    pub what: &'static str,
    /// Reaction of teleopd.
    pub answer: Answer,
}

/// Reaction of teleopd to a hazard.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Answer {
    /// A reaction. Every test with the id in its name shows it.
    Does {
        /// The reaction.
        does: &'static str,
        /// Bound on the reaction: a time or a count.
        within: &'static str,
    },
    /// The hazard does not apply.
    Struck {
        /// Reason.
        because: &'static str,
    },
}

/// The groups of the list, in its order: title and hazards.
pub const GROUPS: [(&str, &[Hazard]); 17] = [
    ("Contents of a skeleton", input::CONTENT),
    ("Timing of skeletons", input::TIMING),
    ("Network and numbers", robot::NUMBERS),
    ("Limits, whole-body control, self-collision", robot::LIMITS),
    ("Driver and robot", robot::DRIVER),
    ("Engagement and lease", robot::AUTHORITY),
    ("Processes and operating system", system::PROCESSES),
    ("Shared memory", system::MEMORY),
    ("Files", system::FILES),
    ("Intruders", system::INTRUDERS),
    ("A robot on ROS 2", robot::ROS2),
    ("The clutch", robot::CLUTCH),
    ("Grippers", robot::GRIPPERS),
    ("A webcam in a page", input::WEBCAM),
    ("A link between two machines", system::LINK),
    ("A headset in a page", input::HEADSET),
    ("A page for other machines", system::PAGE),
];

/// Returns every hazard, in the order of the groups.
pub fn all() -> impl Iterator<Item = &'static Hazard> {
    GROUPS.iter().flat_map(|(_, hazards)| hazards.iter())
}

/// Creates a row with a reaction and its bound.
const fn does(id: &'static str, what: &'static str, does: &'static str, within: &'static str) -> Hazard {
    Hazard { id, what, answer: Answer::Does { does, within } }
}

/// Creates a row that is struck.
const fn struck(id: &'static str, what: &'static str, because: &'static str) -> Hazard {
    Hazard { id, what, answer: Answer::Struck { because } }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hazard_ids_count_up_from_one_without_gap() {
        for (index, hazard) in all().enumerate() {
            assert_eq!(hazard.id, format!("f{:03}", index + 1), "{}", hazard.what);
        }
        assert_eq!(all().count(), 136);
    }

    #[test]
    fn hazard_rows_have_no_empty_text() {
        for hazard in all() {
            let texts = match hazard.answer {
                Answer::Does { does, within } => vec![hazard.what, does, within],
                Answer::Struck { because } => vec![hazard.what, because],
            };
            assert!(texts.iter().all(|text| !text.is_empty() && !text.contains('|')), "{}: {texts:?}", hazard.id);
        }
    }
}
