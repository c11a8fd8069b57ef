//! Compares the robot's hands with the person's.

use messages::{JOINTS_MAX, JointCommand, JointTarget};
use nalgebra::{Matrix3, Rotation3, UnitQuaternion};
use retarget::{pointed, rotation_from_xyzw};
use robot::{Frames, Model, segment_distance};

/// A hand counts as free if the best posture of its wrist leaves every pair so much clearance, m: twice what commands keep.
/// Nearer than that, it has to turn away.
const FREE_M: f64 = 0.02;

/// Errors of one hand, degrees.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HandError {
    /// Rotation angle between the commanded hand and the person's.
    pub command_deg: f64,
    /// The least that the wrist's joints could reach from the commanded forearm, within their ranges. It knows no
    /// collisions.
    pub optimum_deg: f64,
    /// The hand could be there without coming near anything.
    pub free: bool,
}

/// Returns the errors of the hands that the target knows, left and right.
pub fn errors(model: &Model, target: &JointTarget, command: &JointCommand) -> impl Iterator<Item = HandError> {
    let of = |(side, hand): (usize, [f64; 4])| {
        let person = rotation_from_xyzw(hand)?;
        let (arm, wrist) = (&model.arms[side], &model.wrists[side]);
        let (_, fore) = arm.limb_rotations(&std::array::from_fn(|i| command.q[arm.joints[i]]));
        let off = |q: [f64; 2]| turn(&(fore * wrist.rotation(q))).angle_to(&person).to_degrees();
        let best = pointed(wrist, &(turn(&fore).inverse() * person));
        let commanded = wrist.joints.map(|j| command.q[j]);
        let mut there = command.q;
        wrist.joints.into_iter().zip(best).for_each(|(j, q)| there[j] = q);
        Some(HandError { command_deg: off(commanded), optimum_deg: off(best), free: is_free(model, &there) })
    };
    let hands: Vec<HandError> = target.human_hands.into_iter().enumerate().filter_map(of).collect();
    hands.into_iter()
}

fn turn(matrix: &Matrix3<f64>) -> UnitQuaternion<f64> {
    UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(*matrix))
}

/// Returns true if every checked pair keeps [`FREE_M`] at these positions.
fn is_free(model: &Model, q: &[f64; JOINTS_MAX]) -> bool {
    let mut frames = Frames::default();
    model.forward(q, &mut frames);
    model.pairs.iter().all(|pair| {
        let [a, b] = [pair.a, pair.b].map(|capsule| {
            let capsule = &model.capsules[capsule];
            let pose = &frames.base_from_body[capsule.body];
            (pose.transform_point(&capsule.a), pose.transform_point(&capsule.b), capsule.radius_m)
        });
        segment_distance(&a.0, &a.1, &b.0, &b.1).distance_m - a.2 - b.2 >= FREE_M
    })
}
