//! Says how closely the robot follows, and what keeps it from the person.

use crate::sentences::subject;
use messages::{FollowingLimit, Status, Subject, source_flag};
use robot::Names;

/// Limb error below which the robot counts as being at the person, deg. Nobody sees a smaller one. Assumption.
pub const BEHIND_DEG: f64 = 3.0;

/// Says how far the robot still is from the posture that it will follow, and which limit or arm keeps it from there.
pub(crate) fn engages(status: &Status, names: &Names) -> String {
    let away = behind_deg(status).map(|degrees| format!(", {degrees:.0} degrees behind{}", limit(status, names)));
    let is_policy = status.sources & (source_flag::POLICY[0] | source_flag::POLICY[1]) != 0;
    let whose = if is_policy { "policy" } else { "person" };
    format!("The robot moves to the {whose}'s posture slowly{}.{}", away.unwrap_or_default(), unseen(status))
}

/// Says how closely the robot follows, and which limit or arm keeps it from the person.
pub(crate) fn follows(status: &Status, names: &Names) -> String {
    let who = match status.left_out & 3 {
        1 => "The robot's right arm",
        2 => "The robot's left arm",
        _ => "The robot",
    };
    let behind = behind_deg(status).map(|degrees| format!(", {degrees:.0} degrees behind{}", limit(status, names)));
    let [left, right] = source_flag::POLICY.map(|bit| status.sources & bit != 0);
    let led = match (left, right) {
        (true, true) => " the policy",
        (true, false) => " the policy with the left arm, and the person with the right one",
        (false, true) => " the policy with the right arm, and the person with the left one",
        (false, false) => "",
    };
    format!("{who} follows{led}{}.{}", behind.unwrap_or_default(), unseen(status))
}

/// Mean angle between the limbs of the robot and of the person, degrees. `None` if nobody sees it.
fn behind_deg(status: &Status) -> Option<f64> {
    Some(status.limb_error_measured_rad.to_degrees()).filter(|&degrees| degrees >= BEHIND_DEG)
}

/// The limit that the command has reached, after a colon. Empty if there is none.
fn limit(status: &Status, names: &Names) -> String {
    let about = subject(Subject::from_code(status.limited_about), names);
    let limit = about.and_then(|about| match FollowingLimit::from_u32(status.limited_why) {
        FollowingLimit::None => None,
        FollowingLimit::Speed => Some(format!(": {about} is at its highest speed")),
        FollowingLimit::Clearance => Some(format!(": {about} are as close as they may be")),
        FollowingLimit::Range => Some(format!(": {about} is at the end of its range")),
    });
    limit.unwrap_or_default()
}

/// A sentence about the person's arms that nobody sees. Empty if both are seen.
fn unseen(status: &Status) -> &'static str {
    match status.left_out >> 2 {
        1 => " The person's left arm is not seen well enough.",
        2 => " The person's right arm is not seen well enough.",
        3 => " Neither of the person's arms is seen well enough.",
        _ => "",
    }
}
