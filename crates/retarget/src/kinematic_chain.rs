//! Kinematic chain of a left arm: places from the middle between the shoulders, over the joints, to the middle of the hand.

use crate::arm::{ARM_Q, ArmModel, ArmQ};
use nalgebra::Vector3;

/// The arm at the reference posture, in the torso frame, with joints 6 and 7 at home.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct KinematicChain {
    /// Origin of each joint, from the middle between the shoulders, m.
    pub joints: [Vector3<f64>; ARM_Q],
    /// The middle of the hand, from the same point, m.
    pub hand: Vector3<f64>,
}

impl KinematicChain {
    /// The middle of the hand at `q`, from the middle between the shoulders, m.
    pub fn hand_center(&self, arm: &ArmModel, q: &ArmQ) -> Vector3<f64> {
        self.linearize(arm, q).0
    }

    /// The hand, and its derivative by each joint, m/rad: w_j x (hand - c_j) for an axis w_j through c_j.
    pub fn linearize(&self, arm: &ArmModel, q: &ArmQ) -> (Vector3<f64>, [[f64; 3]; ARM_Q]) {
        let rotations = arm.rotations(q);
        let ends = |j: usize| self.joints.get(j + 1).unwrap_or(&self.hand) - self.joints[j];
        let (mut at, mut turned) = (self.joints[0], nalgebra::UnitQuaternion::identity());
        let (mut axes, mut centers) = ([Vector3::zeros(); ARM_Q], [Vector3::zeros(); ARM_Q]);
        for j in 0..ARM_Q {
            (axes[j], centers[j]) = (turned * arm.axes[j], at);
            turned *= nalgebra::UnitQuaternion::new_unchecked(rotations[j]);
            at += turned * ends(j);
        }
        (at, std::array::from_fn(|j| axes[j].cross(&(at - centers[j])).into()))
    }
}
