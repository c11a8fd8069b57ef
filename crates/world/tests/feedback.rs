//! Clearances, directions and grippers in the feedback for clients.

use crate::support;

use messages::{Layout, RobotState, feedback_flag, state_flag};
use retarget::ArmModel;

#[test]
fn arms_that_mirror_have_mirrored_feedback() {
    let model = support::loaded().model;
    let mut state = RobotState { q_measured: model.home, flags: state_flag::GRIPPERS, ..RobotState::ZERO };
    state.grippers_measured.force_n = [3.0, 0.0];
    let feedback = control::feedback(&model, &ArmModel::both(&model), &state, None);
    let [left, right] = feedback.towards_nearest;
    assert!((feedback.clearance_m[0] - feedback.clearance_m[1]).abs() < 5e-3, "{:?}", feedback.clearance_m);
    assert!(feedback.clearance_m[0] > 0.01 && (left[1] + right[1]).abs() < 0.1 && left[1] < 0.0, "{left:?} {right:?}");
    assert_eq!((feedback.force_n, feedback.limb_behind_rad), ([3.0, 0.0], [0.0; 4]));
    let grippers = feedback_flag::GRIPPER[0] | feedback_flag::GRIPPER[1];
    assert_eq!(feedback.known, feedback_flag::STATE | grippers);
    let silent = RobotState { flags: 0, ..state };
    let feedback = control::feedback(&model, &ArmModel::both(&model), &silent, None);
    let given = (feedback.known, feedback.force_n);
    assert_eq!(given, (feedback_flag::STATE, [0.0; 2]), "a robot without grippers says nothing");
}
