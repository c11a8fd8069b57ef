//! Two joints in a row that turn what a person points: a wrist's last two, or those of a head.

use crate::model::Model;
use crate::pose::rotation;
use nalgebra::{Matrix3, Vector3};

/// Two revolute joints in a row. Rot(n, w) is the rotation by w about n. In the torso frame (x forward, y left, z up)
/// they turn a hand against its forearm, or a head against the chest, by
/// R(q) = Rot(axes 1, q1 - home1) Rot(axes 2, q2 - home2).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TwoAxes {
    /// Indices of the joints in the order of messages.
    pub joints: [usize; 2],
    /// Unit axes in the torso frame. Both joints are at home, and an arm is in its T-pose.
    pub axes: [Vector3<f64>; 2],
    /// Positions of a straight hand or head, rad: those of the home posture.
    pub home: [f64; 2],
    /// Lower limits in force, rad.
    pub q_min: [f64; 2],
    /// Upper limits in force, rad.
    pub q_max: [f64; 2],
}

impl TwoAxes {
    /// A placeholder until the model is complete enough.
    pub(crate) fn blank() -> Self {
        let axes = [Vector3::zeros(); 2];
        Self { joints: [0; 2], axes, home: [0.0; 2], q_min: [0.0; 2], q_max: [0.0; 2] }
    }

    /// R(q) at the positions `q`, rad.
    pub fn rotation(&self, q: [f64; 2]) -> Matrix3<f64> {
        rotation(&self.axes[0], q[0] - self.home[0]) * rotation(&self.axes[1], q[1] - self.home[1])
    }
}

impl Model {
    /// Derives the joints of a wrist or a head. `reference`: positions of the arms' joints in the T-pose, on top of the home
    /// posture.
    pub(crate) fn two_axes(&self, joints: [usize; 2], reference: &[(usize, f64)]) -> TwoAxes {
        let mut q = self.home;
        for &(j, position) in reference {
            q[j] = position;
        }
        let limits = joints.map(|j| self.limits[j]);
        TwoAxes {
            joints,
            axes: self.axes_at(&q, joints, self.torso_body),
            home: joints.map(|j| self.home[j]),
            q_min: limits.map(|limits| limits.q_min),
            q_max: limits.map(|limits| limits.q_max),
        }
    }
}
