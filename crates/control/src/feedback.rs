//! Feedback for the person: how near each arm is to something, and how far each limb is behind.

use crate::status::limb_angles;
use messages::{Feedback, JointTarget, Layout, RobotState, feedback_flag, state_flag};
use nalgebra::Vector3;
use retarget::ArmModel;
use robot::{Capsule, Frames, Model, Solid, segment_distance};

/// Step of a difference quotient, m: far above the rounding, far below a finger.
const STEP_M: f64 = 1e-5;

/// Returns what the measured robot says to the person. Mode, faults, speed and sentence are those of a status, and are left
/// out. Not for a tick: it measures every checked pair.
pub fn feedback(model: &Model, arm: &ArmModel, state: &RobotState, target: Option<&JointTarget>) -> Feedback {
    let mut feedback = Feedback { known: feedback_flag::STATE, ..Feedback::ZERO };
    let mut frames = Frames::default();
    model.forward(&state.q_measured, &mut frames);
    let torso = frames.base_from_body[model.torso_body].r;
    for side in 0..2 {
        let (clearance_m, towards) = nearest(model, &frames, side).unwrap_or((f64::INFINITY, Vector3::zeros()));
        feedback.clearance_m[side] = clearance_m as f32;
        feedback.towards_nearest[side] = torso.tr_mul(&towards).map(|x| x as f32).into();
        if model.grippers[side].is_some() && state.flags & state_flag::GRIPPERS != 0 {
            feedback.known |= feedback_flag::GRIPPER[side];
            feedback.closure[side] = state.grippers_measured.closure[side] as f32;
            feedback.force_n[side] = state.grippers_measured.force_n[side] as f32;
        }
    }
    let behind = target.map(|target| limb_angles(model, arm, target, &state.q_measured)).unwrap_or_default();
    for (limb, angle) in behind.into_iter().enumerate() {
        let Some(angle) = angle else { continue };
        feedback.limb_behind_rad[limb] = angle as f32;
        feedback.known |= feedback_flag::LIMB[limb];
    }
    feedback
}

/// Returns the smallest clearance of an arm, m, and the direction from there to what is nearest, in the base frame. `None`
/// without a checked pair.
fn nearest(model: &Model, frames: &Frames, side: usize) -> Option<(f64, Vector3<f64>)> {
    let on_arm = |capsule: &Capsule| model.arms[side].joints.iter().any(|joint| joint + 1 == capsule.body);
    let mut least: Option<(f64, Vector3<f64>)> = None;
    let mut offer = |clearance_m: f64, towards: Vector3<f64>| {
        if least.is_none_or(|(before_m, _)| clearance_m < before_m) {
            least = Some((clearance_m, towards));
        }
    };
    for pair in &model.pairs {
        // The capsule that is farther out on the arm comes near the other one.
        let (own, other) = match (on_arm(&model.capsules[pair.a]), on_arm(&model.capsules[pair.b])) {
            (false, false) => continue,
            (true, false) => (&model.capsules[pair.a], &model.capsules[pair.b]),
            (_, true) => (&model.capsules[pair.b], &model.capsules[pair.a]),
        };
        let ([a, b], [c, d]) = (own.ends(frames), other.ends(frames));
        let near = segment_distance(&a, &b, &c, &d);
        let way = (c + (d - c) * near.t) - (a + (b - a) * near.s);
        offer(way.norm() - own.radius_m - other.radius_m, way.try_normalize(1e-9).unwrap_or_default());
    }
    for obstacle in &model.obstacles {
        for capsule in model.capsules.iter().filter(|capsule| on_arm(capsule)) {
            let [a, b] = capsule.ends(frames);
            let distance_m = obstacle.solid.segment_distance(&a, &b);
            offer(distance_m - capsule.radius_m, towards(&obstacle.solid, &a, &b, distance_m));
        }
    }
    least
}

/// Direction in which a segment comes nearer to an obstacle: minus the gradient of its distance.
fn towards(solid: &Solid, a: &Vector3<f64>, b: &Vector3<f64>, distance_m: f64) -> Vector3<f64> {
    let slope = |axis: usize| {
        let step = Vector3::from_fn(|row, _| if row == axis { STEP_M } else { 0.0 });
        (distance_m - solid.segment_distance(&(a + step), &(b + step))) / STEP_M
    };
    Vector3::new(slope(0), slope(1), slope(2)).try_normalize(1e-6).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn obstacle_is_in_its_direction() {
        let plane = Solid::HalfSpace { normal: Vector3::x(), offset_m: -1.0 };
        let (a, b) = (Vector3::new(0.0, 0.1, 0.0), Vector3::new(0.1, 0.0, 0.3));
        let way = towards(&plane, &a, &b, plane.segment_distance(&a, &b));
        assert!((way + Vector3::x()).norm() < 1e-6, "{way}");
    }
}
