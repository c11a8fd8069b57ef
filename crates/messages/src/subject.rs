//! What a fault, a denial or a refusal is about: a joint, or a pair of parts.

use crate::joints::JOINTS;

/// Largest index of a part in a code: 15 bits, of which a robot's 128 parts need 7.
const PART_MAX: u32 = (1 << 15) - 1;
/// This bit tells a pair's code from a joint's.
const PAIR: u32 = 1 << 31;

/// A joint, or a pair of parts, as messages carry it in one number; zero stands for neither.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Subject {
    /// A joint by its index.
    Joint(usize),
    /// Two capsules as indices of the robot file; the second may be an obstacle, as in `Status::nearest_pair`.
    Pair([u32; 2]),
}

impl Subject {
    /// Its code: 1 + j for joint j, 2^31 + 2^15 a + b for the pair (a, b). Indices that no robot has are neither.
    pub const fn code(self) -> u32 {
        match self {
            Self::Joint(joint) if joint < JOINTS => 1 + joint as u32,
            Self::Pair([a, b]) if a <= PART_MAX && b <= PART_MAX => PAIR | a << 15 | b,
            Self::Joint(_) | Self::Pair(_) => 0,
        }
    }

    /// What a code stands for; none for a code that no subject has.
    pub const fn of(code: u32) -> Option<Self> {
        match code {
            0 => None,
            code if code & PAIR != 0 => {
                if code & 1 << 30 != 0 {
                    return None;
                }
                Some(Self::Pair([code >> 15 & PART_MAX, code & PART_MAX]))
            }
            code if code <= JOINTS as u32 => Some(Self::Joint(code as usize - 1)),
            _ => None,
        }
    }
}
