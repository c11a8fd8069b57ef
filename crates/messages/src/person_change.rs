//! Why the person counts as another one than before.

crate::named! {
    /// Why the person counts as another one than before. `flags` of skeletons and targets carry it until the next change.
    #[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
    #[repr(u32)]
    pub enum PersonChange {
        #[default]
        FirstOfIngest = 0 => "first": "The process `ingest` restarted, so the person may be another one.",
        Session = 1 => "session": "The client's session changed: the client restarted, or another client took over.",
        Operator = 2 => "operator": "The client sees another person: its operator_id changed.",
        /// The client was implausible, or silent, for too long.
        Doubtful = 3 => "doubtful": "The client's frames jumped, were implausible or were missing for too long, so the person may be another one.",
        /// `retarget` forgot the arm.
        ArmForgotten = 4 => "arm": "An arm of the person was not seen for 10 s, so the robot's arm is free again.",
        Policy = 5 => "policy": "A policy began or ended, so the robot would follow another target.",
    }
}

/// The lowest of the three bits in `flags`, above those of the limbs.
const SHIFT: u32 = 5;

impl PersonChange {
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
}
