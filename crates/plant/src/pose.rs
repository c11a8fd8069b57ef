//! A rigid transform.

use nalgebra::{Matrix3, Vector3};

/// A rotation and a translation: `a_from_b` maps coordinates of frame b to those of frame a, x_a = r x_b + t.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// The rotation.
    pub r: Matrix3<f64>,
    /// The translation, m.
    pub t: Vector3<f64>,
}

impl Pose {
    /// Returns the pose of two frames that coincide.
    pub fn identity() -> Self {
        Self { r: Matrix3::identity(), t: Vector3::zeros() }
    }

    /// Returns the pose of a URDF's `origin`: fixed-axis roll, pitch and yaw, R = Rz(yaw) Ry(pitch) Rx(roll).
    pub fn from_origin(xyz: [f64; 3], rpy: [f64; 3]) -> Self {
        let [roll, pitch, yaw] = rpy;
        let about = |axis: Vector3<f64>, angle: f64| turn(&axis, angle);
        Self { r: about(Vector3::z(), yaw) * about(Vector3::y(), pitch) * about(Vector3::x(), roll), t: xyz.into() }
    }

    /// Returns the pose of a URDF's `origin` with a quaternion of any length but zero: R = 1 + 2 (w K + K^2) / |q|^2, K the
    /// cross product with (x, y, z).
    pub(crate) fn from_quaternion(xyz: [f64; 3], [x, y, z, w]: [f64; 4]) -> Self {
        let k = Vector3::new(x, y, z).cross_matrix();
        let square = x * x + y * y + z * z + w * w;
        Self { r: Matrix3::identity() + (k * w + k * k) * (2.0 / square), t: xyz.into() }
    }

    /// Returns a_from_c, given a_from_b and b_from_c.
    pub fn then(&self, next: &Self) -> Self {
        Self { r: self.r * next.r, t: self.r * next.t + self.t }
    }

    /// Returns the coordinates in frame a of a point given in frame b, m.
    pub fn point(&self, p: &Vector3<f64>) -> Vector3<f64> {
        self.r * p + self.t
    }
}

/// Returns the rotation by `angle` (rad) about a unit axis, by Rodrigues' formula: 1 + sin K + (1 - cos) K^2.
pub(crate) fn turn(axis: &Vector3<f64>, angle: f64) -> Matrix3<f64> {
    let k = axis.cross_matrix();
    let (sin, cos) = angle.sin_cos();
    Matrix3::identity() + k * sin + k * k * (1.0 - cos)
}
