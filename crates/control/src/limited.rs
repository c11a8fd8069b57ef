//! Limits that keep the command from the person.

use messages::{FollowingLimit, JointMotion, Status, Subject};
use robot::Model;

/// A joint is at its highest speed from this share of it. Assumption.
const AT_SPEED: f64 = 0.95;

/// A joint this near to the end of its range is at the end, rad: 0.6 degrees. Assumption.
const AT_END_RAD: f64 = 0.01;

/// Two parts are as close as allowed if they are this little above the least clearance, m. Assumption.
const AT_CLEARANCE_M: f64 = 1e-3;

/// Writes into `status` the limit that the command `motion` has reached. Only limits that an operator can see
/// count: the joint nearest to its highest speed, the nearest pair, or a joint at the end of its range. Wrists turn no limb, so
/// no limb is behind because of them.
pub(super) fn report(status: &mut Status, follows: bool, motion: &JointMotion, wbc: &wbc::Config, model: &Model) {
    let bounds = wbc.bounds();
    let arms = || model.arms.iter().flat_map(robot::Arm::limb_joints);
    let speed = |j: usize| motion.v[j].abs() / bounds[j].v_max;
    let fastest = arms().max_by(|&a, &b| speed(a).total_cmp(&speed(b))).filter(|&j| speed(j) >= AT_SPEED);
    let close = status.clearance_command_m <= model.d_min_m + AT_CLEARANCE_M;
    let end = |j: usize| (motion.q[j] - bounds[j].q_min).min(bounds[j].q_max - motion.q[j]) <= AT_END_RAD;
    let (why, about) = match (fastest, arms().find(|&j| end(j))) {
        _ if !follows => (FollowingLimit::None, None),
        (Some(j), _) => (FollowingLimit::Speed, Some(Subject::Joint(j))),
        _ if close => (FollowingLimit::Clearance, Some(Subject::Pair(status.nearest_pair))),
        (None, Some(j)) => (FollowingLimit::Range, Some(Subject::Joint(j))),
        (None, None) => (FollowingLimit::None, None),
    };
    (status.limited_why, status.limited_about) = (why as u32, about.map_or(0, Subject::code));
}

#[cfg(test)]
mod tests {
    use super::report;
    use messages::{FollowingLimit, JointMotion, Layout, Status, Subject};
    use robot::Model;

    /// TIAGo++: the joints of its left arm.
    const LEFT_ARM: std::ops::Range<usize> = 3..10;

    #[test]
    fn status_names_active_limit_only_while_following() {
        const TOML: &str = include_str!("../../../config/robots/tiago_dual.toml");
        const URDF: &str = include_str!("../../../config/robots/tiago_dual.urdf");
        let model = Model::from_text("r.toml", TOML, "r.urdf", URDF).expect("the shipped robot");
        let wbc = wbc::Config::new(&model, wbc::Options::default()).expect("the shipped robot");
        let mut status = Status { clearance_command_m: 0.5, nearest_pair: [3, 8], ..Status::ZERO };
        let mut reported = |motion: &JointMotion, clearance_m: f64, follows: bool| {
            status.clearance_command_m = clearance_m;
            report(&mut status, follows, motion, &wbc, &model);
            (FollowingLimit::from_u32(status.limited_why), Subject::from_code(status.limited_about))
        };
        let mut motion = JointMotion::rest(model.home);
        assert_eq!(reported(&motion, 0.5, true), (FollowingLimit::None, None));
        motion.q[LEFT_ARM.start] = wbc.bounds()[LEFT_ARM.start].q_min + 0.005;
        assert_eq!(reported(&motion, 0.5, true), (FollowingLimit::Range, Some(Subject::Joint(LEFT_ARM.start))));
        assert_eq!(reported(&motion, 0.0105, true), (FollowingLimit::Clearance, Some(Subject::Pair([3, 8]))));
        motion.v[LEFT_ARM.start + 5] = wbc.bounds()[LEFT_ARM.start + 5].v_max;
        assert_eq!(reported(&motion, 0.0105, true), (FollowingLimit::Clearance, Some(Subject::Pair([3, 8]))));
        motion.v[LEFT_ARM.start + 2] = -0.97 * wbc.bounds()[LEFT_ARM.start + 2].v_max;
        assert_eq!(reported(&motion, 0.0105, true), (FollowingLimit::Speed, Some(Subject::Joint(LEFT_ARM.start + 2))));
        assert_eq!(
            reported(&motion, 0.0105, false),
            (FollowingLimit::None, None),
            "a robot that does not follow is behind nobody"
        );
    }
}
