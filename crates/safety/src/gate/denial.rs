//! The reasons for a denial, with their codes and texts.

use super::Check;
use messages::Subject;

/// The reason why a command was denied. `pair` has the indices of two capsules in the robot file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(missing_docs, reason = "the variants describe the fields")]
pub enum Denial {
    /// The last seed was not finite or does not come to rest.
    Seed,
    /// The command is not for the tick that follows the last one.
    Index,
    /// The command is a new motion without permission to move.
    Permit,
    /// A joint fails a check.
    Joint { joint: usize, check: Check },
    /// Two capsules are too close at the command.
    ClearanceAtCommand { pair: [u32; 2] },
    /// Two capsules are too close where the plan rests.
    ClearanceAtRest { pair: [u32; 2] },
    /// Two capsules are too close at an instant of the stop, before it ends.
    ClearanceOnTheWay { pair: [u32; 2] },
    /// An elbow or a hand is too fast, at the command or at an instant of the stop.
    HandSpeed {
        /// The joint that carries it: an arm's fifth or seventh.
        joint: usize,
    },
    /// A gripper is too fast, leaves its range or does not continue. 0 is the left one.
    Gripper { side: usize },
}

/// Code of the first check. Each check has one code, in their order.
const FIRST_CHECK: u32 = 6;
/// Code of the first denial that was added after the checks. A code never changes its meaning, because
/// recordings contain it.
const ON_THE_WAY: u32 = 15;
const HAND_SPEED: u32 = 16;
const ABSENT: u32 = 17;
const GRIPPER: u32 = 18;

impl Denial {
    /// Code in `Status::denied_why`. Never zero.
    pub const fn code(self) -> u32 {
        match self {
            Self::Seed => 1,
            Self::Index => 2,
            Self::Permit => 3,
            Self::ClearanceAtCommand { .. } => 4,
            Self::ClearanceAtRest { .. } => 5,
            Self::ClearanceOnTheWay { .. } => ON_THE_WAY,
            Self::HandSpeed { .. } => HAND_SPEED,
            Self::Gripper { .. } => GRIPPER,
            Self::Joint { check: Check::Absent, .. } => ABSENT,
            Self::Joint { check, .. } => FIRST_CHECK + check as u32,
        }
    }

    /// The joint or pair that is the subject, if there is one.
    pub const fn subject(self) -> Option<Subject> {
        match self {
            Self::Seed | Self::Index | Self::Permit | Self::Gripper { .. } => None,
            Self::Joint { joint, .. } | Self::HandSpeed { joint } => Some(Subject::Joint(joint)),
            Self::ClearanceAtCommand { pair } | Self::ClearanceAtRest { pair } | Self::ClearanceOnTheWay { pair } => {
                Some(Subject::Pair(pair))
            }
        }
    }

    /// Text for a code, to be followed by the subject. None for a code that no denial has.
    pub const fn meaning(code: u32) -> Option<&'static str> {
        Some(match code {
            1 => "there was no usable state to continue from",
            2 => "the command was for another tick",
            3 => "a new motion was not permitted",
            4 => "parts were too close at the command",
            5 => "parts would be too close where the stop ends",
            ON_THE_WAY => "parts would come too close during the stop",
            ABSENT => "a joint that the robot does not have was not at zero",
            GRIPPER => "a gripper left its range, was too fast, or did not continue its motion",
            HAND_SPEED => "an elbow or a hand was faster than hand_speed_max_m_per_s",
            code => match code.wrapping_sub(FIRST_CHECK) {
                check if check == Check::Finite as u32 => "a number was NaN or infinite, or beyond every robot's",
                check if check == Check::Position as u32 => "a position left its limits",
                check if check == Check::Velocity as u32 => "a velocity left its limits",
                check if check == Check::Acceleration as u32 => "an acceleration left its limits",
                check if check == Check::Jerk as u32 => "the jerk left its limits",
                check if check == Check::Step as u32 => "the command did not continue the previous one",
                check if check == Check::SpeedScale as u32 => "the command was faster than now permitted",
                check if check == Check::PlanLimits as u32 => "the stop would leave the limits",
                check if check == Check::Braking as u32 => "the stop would not come to rest in time",
                _ => return None,
            },
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn denials_have_unique_codes_and_meanings() {
        let checks = [
            Check::Finite,
            Check::Position,
            Check::Velocity,
            Check::Acceleration,
            Check::Jerk,
            Check::Step,
            Check::SpeedScale,
            Check::PlanLimits,
            Check::Braking,
            Check::Absent,
        ];
        let pair = [3, 9];
        let mut all = vec![Denial::Seed, Denial::Index, Denial::Permit];
        all.extend([Denial::ClearanceAtCommand { pair }, Denial::ClearanceAtRest { pair }]);
        all.extend([Denial::ClearanceOnTheWay { pair }, Denial::HandSpeed { joint: 9 }]);
        all.push(Denial::Gripper { side: 1 });
        all.extend(checks.map(|check| Denial::Joint { joint: 4, check }));
        let mut codes: Vec<_> = all.iter().map(|denial| denial.code()).collect();
        let meanings: std::collections::BTreeSet<_> = codes.iter().map(|&code| Denial::meaning(code)).collect();
        assert!(!meanings.contains(&None) && meanings.len() == all.len(), "{meanings:?}");
        codes.sort_unstable();
        codes.dedup();
        assert_eq!(codes.len(), all.len());
        assert_eq!((Denial::meaning(0), Denial::meaning(99)), (None, None));
        assert_eq!(all[3].subject(), Some(Subject::Pair(pair)));
        assert_eq!((all[5].subject(), all[6].subject()), (all[3].subject(), Some(Subject::Joint(9))));
        assert_eq!(all[8].subject(), Some(Subject::Joint(4)));
        assert_eq!(all[0].subject(), None);
    }
}
