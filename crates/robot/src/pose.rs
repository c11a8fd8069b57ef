//! Rigid transforms.

use nalgebra::{Matrix3, Vector3};

/// A rigid transform: x_outer = r x_inner + t. `base_from_hand` chains by cancelling: a_from_b * b_from_c.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// Rotation, 3 x 3.
    pub r: Matrix3<f64>,
    /// Translation, m.
    pub t: Vector3<f64>,
}

impl Pose {
    /// The identity: no rotation and no translation.
    pub fn identity() -> Self {
        Self { r: Matrix3::identity(), t: Vector3::zeros() }
    }

    /// The transform of a URDF `origin`: R = Rz(yaw) Ry(pitch) Rx(roll), angles in rad, translation in m.
    pub fn from_xyz_rpy(xyz: [f64; 3], rpy: [f64; 3]) -> Self {
        let [(sr, cr), (sp, cp), (sy, cy)] = rpy.map(f64::sin_cos);
        let r = Matrix3::new(
            cy * cp,
            cy * sp * sr - sy * cr,
            cy * sp * cr + sy * sr,
            sy * cp,
            sy * sp * sr + cy * cr,
            sy * sp * cr - cy * sr,
            -sp,
            cp * sr,
            cp * cr,
        );
        Self { r, t: Vector3::from(xyz) }
    }

    /// Returns `self` composed with `inner`: a_from_c = a_from_b * b_from_c.
    pub fn compose(&self, inner: &Self) -> Self {
        Self { r: self.r * inner.r, t: self.r * inner.t + self.t }
    }

    /// Returns the inverse: b_from_a of a_from_b.
    pub fn inverse(&self) -> Self {
        let r = self.r.transpose();
        Self { r, t: -(r * self.t) }
    }

    /// Converts a point from the inner frame to the outer one, m.
    pub fn transform_point(&self, point: &Vector3<f64>) -> Vector3<f64> {
        self.r * point + self.t
    }
}

/// The rotation by `angle` rad about a unit axis, by Rodrigues' formula: I + sin K + (1 - cos) K^2.
pub(crate) fn rotation(axis: &Vector3<f64>, angle: f64) -> Matrix3<f64> {
    let k = axis.cross_matrix();
    let (sin, cos) = angle.sin_cos();
    Matrix3::identity() + k * sin + k * k * (1.0 - cos)
}
