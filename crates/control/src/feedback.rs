//! Feedback for the person: how near each arm is to something, and how far each limb is behind.

use crate::status::limb_angles;
use crate::target::limbs;
use messages::{Feedback, JointTarget, Layout, RobotState, feedback_flag, state_flag};
use nalgebra::Vector3;
use retarget::ArmModel;
use robot::{Frames, Model};

/// Returns what the measured robot says to the person. Mode, faults, speed and sentence are those of a status, and are left
/// out. Not for a tick: it measures every checked pair.
pub fn feedback(model: &Model, arms: &[ArmModel; 2], state: &RobotState, target: Option<&JointTarget>) -> Feedback {
    let mut feedback = Feedback { known: feedback_flag::STATE, ..Feedback::ZERO };
    let mut frames = Frames::default();
    model.forward(&state.q_measured, &mut frames);
    let torso = model.base_from_torso(&frames);
    for side in 0..2 {
        let near = model.nearest_to_arm(&frames, side);
        feedback.clearance_m[side] = near.map_or(f32::INFINITY, |near| near.clearance_m as f32);
        let towards = near.map_or_else(Vector3::zeros, |near| near.towards);
        feedback.towards_nearest[side] = torso.tr_mul(&towards).map(|x| x as f32).into();
        if model.grippers[side].is_some() && state.flags & state_flag::GRIPPERS != 0 {
            feedback.known |= feedback_flag::GRIPPER[side];
            feedback.closure[side] = state.grippers_measured.closure[side] as f32;
            feedback.force_n[side] = state.grippers_measured.force_n[side] as f32;
        }
    }
    let person = target.map(|target| [0, 1].map(|side| limbs(target, side))).unwrap_or_default();
    let behind = limb_angles(model, arms, &person, &state.q_measured);
    for (limb, angle) in behind.into_iter().enumerate() {
        let Some(angle) = angle else { continue };
        feedback.limb_behind_rad[limb] = angle as f32;
        feedback.known |= feedback_flag::LIMB[limb];
    }
    feedback
}
