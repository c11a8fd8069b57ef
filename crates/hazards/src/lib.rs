//! Everything that can go wrong, in one list: each hazard has an id, what teleopd does about it, and within what.
//!
//! Each id is carried by the name of at least one test, as in `fn f021_...`; `tests/tidy.rs` fails on an id without one.
//! What does not apply to teleopd is struck here, with the reason. `messages::FAULTS` is another list: of the few faults
//! by which the daemon tells at run time what it reacts to.
//!
//! B is the longest stop, 0.5 s (SAFETY.md); a tick is 1/1500 s. Times of the 1500 Hz streams are multiplied by
//! `safety.stale_factor_without_realtime` where a machine without real-time scheduling drives a simulated robot.

mod input;
mod robot;
mod system;

/// One hazard.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Hazard {
    /// `f` and a number of three digits; it never changes, and is never used again.
    pub id: &'static str,
    /// What goes wrong.
    pub what: &'static str,
    /// What teleopd does about it.
    pub answer: Answer,
}

/// What teleopd does about a hazard.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Answer {
    /// A reaction, shown by every test whose name carries the id.
    Does {
        /// What.
        does: &'static str,
        /// Within what: a time, a count, a bound.
        within: &'static str,
    },
    /// The hazard does not apply.
    Struck {
        /// Why.
        because: &'static str,
    },
}

/// The groups of the list, in its order: title and hazards.
pub const GROUPS: [(&str, &[Hazard]); 10] = [
    ("What a skeleton says", input::CONTENT),
    ("When it comes", input::TIMING),
    ("Network and numbers", robot::NUMBERS),
    ("Limits, whole-body control, self-collision", robot::LIMITS),
    ("Driver and robot", robot::DRIVER),
    ("Engagement and authority", robot::AUTHORITY),
    ("Processes and operating system", system::PROCESSES),
    ("Shared memory", system::MEMORY),
    ("Files", system::FILES),
    ("Intruders", system::INTRUDERS),
];

/// Every hazard, by id.
pub fn all() -> impl Iterator<Item = &'static Hazard> {
    GROUPS.iter().flat_map(|(_, hazards)| hazards.iter())
}

/// A row of the list: its reaction and the bound on it.
const fn does(id: &'static str, what: &'static str, does: &'static str, within: &'static str) -> Hazard {
    Hazard { id, what, answer: Answer::Does { does, within } }
}

/// A row that is struck.
const fn struck(id: &'static str, what: &'static str, because: &'static str) -> Hazard {
    Hazard { id, what, answer: Answer::Struck { because } }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ids_count_up_from_one_without_a_gap() {
        for (index, hazard) in all().enumerate() {
            assert_eq!(hazard.id, format!("f{:03}", index + 1), "{}", hazard.what);
        }
        assert_eq!(all().count(), 113);
    }

    #[test]
    fn every_row_says_something() {
        for hazard in all() {
            let texts = match hazard.answer {
                Answer::Does { does, within } => vec![hazard.what, does, within],
                Answer::Struck { because } => vec![hazard.what, because],
            };
            assert!(texts.iter().all(|text| !text.is_empty() && !text.contains('|')), "{}: {texts:?}", hazard.id);
        }
    }
}
