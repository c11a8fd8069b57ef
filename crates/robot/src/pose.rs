//! Rigid transforms.

use nalgebra::{Matrix3, Quaternion, UnitQuaternion, Vector3};

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

/// The rotation of a quaternion (x, y, z, w) of any length. `None` for zero.
pub(crate) fn quaternion([x, y, z, w]: [f64; 4]) -> Option<Matrix3<f64>> {
    let turn = UnitQuaternion::try_new(Quaternion::new(w, x, y, z), 0.0)?;
    Some(*turn.to_rotation_matrix().matrix()).filter(|r| r.iter().all(|x| x.is_finite()))
}

/// Roll, pitch and yaw of a rotation, rad: the inverse of [`Pose::from_xyz_rpy`]. Where only the difference of roll and yaw
/// matters, the roll is zero.
pub(crate) fn rpy_of(r: &Matrix3<f64>) -> [f64; 3] {
    let level = r[(0, 0)].hypot(r[(1, 0)]);
    let pitch = (-r[(2, 0)]).atan2(level);
    // 1e-9: below it, what is left of the first column is rounding.
    if level < 1e-9 {
        return [0.0, pitch, (-r[(0, 1)]).atan2(r[(1, 1)])];
    }
    [r[(2, 1)].atan2(r[(2, 2)]), pitch, r[(1, 0)].atan2(r[(0, 0)])]
}
