//! Subject of a fault, a denial or a refusal: a joint, a pair of parts, or the change of the person.

use crate::joints::JOINTS_MAX;
use crate::person_change::PersonChange;

/// Largest index of a part in a code. It has 15 bits, and a robot's 128 parts need 7.
const PART_MAX: u32 = (1 << 15) - 1;
/// Bit that marks the code of a pair.
const PAIR: u32 = 1 << 31;
/// This bit alone tells a person's code.
const PERSON: u32 = 1 << 30;

/// A joint, a pair of parts, or the change of the person. Messages carry it as one number, and zero stands for none.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Subject {
    /// A joint by its index.
    Joint(usize),
    /// Two capsules as indices of the robot file. The second may be an obstacle, as in `Status::nearest_pair`.
    Pair([u32; 2]),
    /// How the person became another one.
    Person(PersonChange),
}

impl Subject {
    /// Returns the code: 1 + j for joint j, 2^31 + 2^15 a + b for the pair (a, b), 2^30 + c for the change c of the
    /// person. Returns zero for indices that no robot has.
    pub const fn code(self) -> u32 {
        match self {
            Self::Joint(joint) if joint < JOINTS_MAX => 1 + joint as u32,
            Self::Pair([a, b]) if a <= PART_MAX && b <= PART_MAX => PAIR | a << 15 | b,
            Self::Person(change) => PERSON | change as u32,
            Self::Joint(_) | Self::Pair(_) => 0,
        }
    }

    /// Decodes a subject. Returns `None` for a code that no subject has.
    pub const fn from_code(code: u32) -> Option<Self> {
        match code {
            0 => None,
            code if code & PAIR != 0 => {
                if code & 1 << 30 != 0 {
                    return None;
                }
                Some(Self::Pair([code >> 15 & PART_MAX, code & PART_MAX]))
            }
            code if code <= JOINTS_MAX as u32 => Some(Self::Joint(code as usize - 1)),
            code if code & PERSON != 0 && ((code ^ PERSON) as usize) < PersonChange::ALL.len() => {
                Some(Self::Person(PersonChange::ALL[(code ^ PERSON) as usize]))
            }
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_subject_has_a_code_of_its_own() {
        let people = PersonChange::ALL.map(Subject::Person);
        let others =
            [Subject::Joint(0), Subject::Joint(JOINTS_MAX - 1), Subject::Pair([0, 0]), Subject::Pair([3, PART_MAX])];
        for subject in people.into_iter().chain(others) {
            assert_eq!(Subject::from_code(subject.code()), Some(subject));
        }
        for code in [0, JOINTS_MAX as u32 + 1, PERSON | PersonChange::ALL.len() as u32, PAIR | PERSON] {
            assert_eq!(Subject::from_code(code), None, "{code:#x}");
        }
        for change in PersonChange::ALL {
            assert_eq!(PersonChange::from_flags(change.flags() | !PersonChange::FLAGS), change);
        }
        assert_eq!(PersonChange::from_flags(PersonChange::FLAGS), PersonChange::FirstOfIngest, "bits of no cause");
    }
}
