//! Compares the robot's hands with the person's.

use messages::{JointCommand, JointTarget};
use nalgebra::{Matrix3, Rotation3, UnitQuaternion};
use retarget::{pointed, rotation_from_xyzw};
use robot::{Frames, Model};

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
pub fn errors(model: &Model, target: &JointTarget, command: &JointCommand) -> Vec<HandError> {
    let of = |(side, hand): (usize, [f64; 4])| {
        let person = rotation_from_xyzw(hand)?;
        let (arm, wrist) = (&model.arms[side], &model.wrists[side]);
        let (_, fore) = arm.limb_rotations(&std::array::from_fn(|i| command.q[arm.joints[i]]));
        let off = |q: [f64; 2]| turn(&(fore * wrist.rotation(q))).angle_to(&person).to_degrees();
        let best = pointed(wrist, &(turn(&fore).inverse() * person));
        let commanded = wrist.joints.map(|j| command.q[j]);
        let mut there = command.q;
        wrist.joints.into_iter().zip(best).for_each(|(j, q)| there[j] = q);
        let mut frames = Frames::default();
        model.forward(&there, &mut frames);
        let (clearance_m, _) = model.clearance(&frames);
        Some(HandError { command_deg: off(commanded), optimum_deg: off(best), free: clearance_m >= FREE_M })
    };
    target.human_hands.into_iter().enumerate().filter_map(of).collect()
}

fn turn(matrix: &Matrix3<f64>) -> UnitQuaternion<f64> {
    UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(*matrix))
}
