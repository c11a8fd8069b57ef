//! Subject of a fault, a denial or a refusal: a joint, or a pair of parts.

use crate::joints::JOINTS;

/// Largest index of a part in a code. It has 15 bits, and a robot's 128 parts need 7.
const PART_MAX: u32 = (1 << 15) - 1;
/// Bit that marks the code of a pair.
const PAIR: u32 = 1 << 31;

/// A joint or a pair of parts. Messages carry it as one number, and zero stands for neither.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Subject {
    /// A joint by its index.
    Joint(usize),
    /// Two capsules as indices of the robot file. The second may be an obstacle, as in `Status::nearest_pair`.
    Pair([u32; 2]),
}

impl Subject {
    /// Returns the code: 1 + j for joint j, 2^31 + 2^15 a + b for the pair (a, b). Returns zero for indices that
    /// no robot has.
    pub const fn code(self) -> u32 {
        match self {
            Self::Joint(joint) if joint < JOINTS => 1 + joint as u32,
            Self::Pair([a, b]) if a <= PART_MAX && b <= PART_MAX => PAIR | a << 15 | b,
            Self::Joint(_) | Self::Pair(_) => 0,
        }
    }

    /// Decodes a subject. Returns `None` for a code that no subject has.
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
