//! The permission to move.

/// Permission for the robot at this tick. The state machine gives it, whole-body control keeps it, and the gate
/// checks that.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Permit {
    /// Follow the target.
    Follow {
        /// Share of each joint's largest speed, (0, 1]. Anything that is not above zero stops. If the share falls below
        /// a joint's present speed, the joint does not get faster.
        speed_scale: f64,
    },
    /// Move slowly back inside the limits and away from near pairs, whatever the target is.
    Recover,
    /// Play the stored stop plan, and rest at its end.
    Stop,
}

impl Permit {
    /// Share of the velocity limit of a motion that follows. Zero for all others.
    pub const fn speed_scale(self) -> f64 {
        match self {
            Self::Follow { speed_scale } => speed_scale,
            Self::Recover | Self::Stop => 0.0,
        }
    }
}
