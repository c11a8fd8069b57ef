//! Why the person counts as another one than before.

/// Why the person counts as another one than before. `flags` of skeletons and targets carry it until the next change.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(u32)]
pub enum PersonChange {
    /// This is the first person of this `ingest`.
    #[default]
    FirstOfIngest = 0,
    /// The client's session changed.
    Session = 1,
    /// The client changed `operator_id`.
    Operator = 2,
    /// The client was implausible, or silent, for too long.
    Doubtful = 3,
    /// `retarget` forgot an arm.
    ArmForgotten = 4,
}

/// The lowest of the three bits in `flags`, above those of the limbs.
const SHIFT: u32 = 5;

impl PersonChange {
    /// Every cause.
    pub const ALL: [Self; 5] = [Self::FirstOfIngest, Self::Session, Self::Operator, Self::Doubtful, Self::ArmForgotten];
    /// The bits that carry it in the `flags` of `Skeleton` and `JointTarget`.
    pub const FLAGS: u32 = 7 << SHIFT;

    /// Its bits in `flags`.
    pub const fn flags(self) -> u32 {
        (self as u32) << SHIFT
    }

    /// Reads the change from `flags`. Returns the default for bits that no cause has.
    pub fn from_flags(flags: u32) -> Self {
        Self::ALL.get((flags >> SHIFT & 7) as usize).copied().unwrap_or_default()
    }

    /// Returns one sentence for the user.
    pub const fn meaning(self) -> &'static str {
        match self {
            Self::FirstOfIngest => "The process `ingest` restarted, so the person may be another one.",
            Self::Session => "The client's session changed: the client restarted, or another client took over.",
            Self::Operator => "The client sees another person: its operator_id changed.",
            Self::Doubtful => {
                "The client's frames jumped, were implausible or were missing for too long, so the person may be another one."
            }
            Self::ArmForgotten => "An arm of the person was not seen for 10 s, so the robot's arm is free again.",
        }
    }
}
