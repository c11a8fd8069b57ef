//! Limits that keep the command from the person.

use driver::Motion;
use messages::{FollowingLimit, JOINTS_MAX, Status, Subject};
use std::ops::Range;
use wbc::interval::Bounds;

/// A joint is at its highest speed from this share of it. Assumption.
const AT_SPEED: f64 = 0.95;

/// A joint this near to the end of its range is at the end, rad: 0.6 degrees. Assumption.
const AT_END_RAD: f64 = 0.01;

/// Two parts are as close as allowed if they are this little above the least clearance, m. Assumption.
const AT_CLEARANCE_M: f64 = 1e-3;

/// Writes into `status` the limit that the command `motion` has reached. Only limits that an operator can see
/// count: the arm joint nearest to its highest speed, the nearest pair, or a joint at the end of its range.
pub(super) fn note(
    status: &mut Status,
    engaged: bool,
    motion: &Motion,
    bounds: &[Bounds; JOINTS_MAX],
    arms: Range<usize>,
    d_min_m: f64,
) {
    let arms = || arms.clone();
    let speed = |j: usize| motion.v[j].abs() / bounds[j].v_max;
    let fastest = arms().max_by(|&a, &b| speed(a).total_cmp(&speed(b))).filter(|&j| speed(j) >= AT_SPEED);
    let close = status.clearance_command_m <= d_min_m + AT_CLEARANCE_M;
    let end = |j: usize| (motion.q[j] - bounds[j].q_min).min(bounds[j].q_max - motion.q[j]) <= AT_END_RAD;
    let (why, about) = match (fastest, arms().find(|&j| end(j))) {
        _ if !engaged => (FollowingLimit::None, None),
        (Some(j), _) => (FollowingLimit::Speed, Some(Subject::Joint(j))),
        _ if close => (FollowingLimit::Clearance, Some(Subject::Pair(status.nearest_pair))),
        (None, Some(j)) => (FollowingLimit::Range, Some(Subject::Joint(j))),
        (None, None) => (FollowingLimit::None, None),
    };
    (status.limited_why, status.limited_about) = (why as u32, about.map_or(0, Subject::code));
}

#[cfg(test)]
mod tests {
    use super::note;
    use driver::Motion;
    use messages::{FollowingLimit, JOINTS_MAX, Layout, Status, Subject};
    use wbc::interval::Bounds;

    /// TIAGo++: the joints of its left arm.
    const LEFT_ARM: std::ops::Range<usize> = 3..10;

    #[test]
    fn status_names_active_limit_only_while_engaged() {
        let bounds =
            [Bounds { q_min: -1.0, q_max: 1.0, v_max: 2.0, a_max: 10.0, brake: 10.0, j_max: 400.0 }; JOINTS_MAX];
        let mut status = Status { clearance_command_m: 0.5, nearest_pair: [3, 8], ..Status::ZERO };
        let mut said = |motion: &Motion, clearance_m: f64, engaged: bool| {
            status.clearance_command_m = clearance_m;
            note(&mut status, engaged, motion, &bounds, 3..17, 0.01);
            (FollowingLimit::from_u32(status.limited_why), Subject::of(status.limited_about))
        };
        let mut motion = Motion::rest([0.0; JOINTS_MAX]);
        assert_eq!(said(&motion, 0.5, true), (FollowingLimit::None, None));
        motion.q[LEFT_ARM.start] = -0.995;
        assert_eq!(said(&motion, 0.5, true), (FollowingLimit::Range, Some(Subject::Joint(LEFT_ARM.start))));
        assert_eq!(said(&motion, 0.0105, true), (FollowingLimit::Clearance, Some(Subject::Pair([3, 8]))));
        motion.v[LEFT_ARM.start + 2] = -1.95;
        assert_eq!(said(&motion, 0.0105, true), (FollowingLimit::Speed, Some(Subject::Joint(LEFT_ARM.start + 2))));
        assert_eq!(
            said(&motion, 0.0105, false),
            (FollowingLimit::None, None),
            "a robot that does not follow is behind nobody"
        );
    }
}
