//! Payload of a hand as an operator sets it, and the reasons for which `control` refuses it.

/// An operator's order for one hand.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PayloadOrder {
    /// Mass, kg.
    pub mass_kg: f64,
    /// Centre of mass in the hand's frame, m. `None` stands for the robot file's centre.
    pub centre_m: Option<[f64; 3]>,
}

/// Reason for which a payload was refused. The payload before it stays in force. `Overload` is a warning: that
/// payload is taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum PayloadRefusal {
    /// The robot is not Disengaged.
    NotDisengaged = 1,
    /// The robot is not at rest.
    Moving = 2,
    /// The mass is out of range.
    Mass = 3,
    /// The centre is out of range.
    Centre = 4,
    /// Neither the order nor the robot file gives a centre of mass.
    NoCentre = 5,
    /// A joint cannot hold this posture with the payload.
    Overload = 6,
}

impl PayloadRefusal {
    const ALL: [Self; 6] =
        [Self::NotDisengaged, Self::Moving, Self::Mass, Self::Centre, Self::NoCentre, Self::Overload];

    /// Returns the refusal with this number.
    pub fn from_u32(number: u32) -> Option<Self> {
        Self::ALL.into_iter().find(|&refusal| refusal as u32 == number)
    }

    /// Returns the meaning and the remedy.
    pub const fn meaning(self) -> &'static str {
        match self {
            Self::NotDisengaged => "the robot is not Disengaged; release or reset it first",
            Self::Moving => "the robot is not at rest; wait until it stands",
            Self::Mass => "the mass is out of range; 0 to 5 kg are allowed",
            Self::Centre => "the centre is out of range; at most 0.5 m from the origin of the hand's frame is allowed",
            Self::NoCentre => "the robot file has no centre for this hand; give it with --centre",
            Self::Overload => {
                "it is accepted, but holding this posture needs more than its share of the effort limit, so the robot \
                 cannot start; take the load off, then report it"
            }
        }
    }
}
