//! Converts vectors and quaternions of messages for the formulas.

use nalgebra::{Matrix3, Quaternion, Rotation3, UnitQuaternion, Vector3};

/// Below this length (m) a bone has no direction: a tenth of a millimetre, far below any tracker's noise.
const LENGTH_MIN_M: f64 = 1e-4;

pub(crate) fn vector(v: [f32; 3]) -> Vector3<f64> {
    Vector3::new(f64::from(v[0]), f64::from(v[1]), f64::from(v[2]))
}

/// Returns the unit vector along `v`, if it has a direction.
pub(crate) fn unit(v: Vector3<f64>) -> Option<Vector3<f64>> {
    let length = v.norm();
    (length > LENGTH_MIN_M && length.is_finite()).then(|| v / length)
}

/// Returns the part of `v` normal to the unit vector `axis`, as a unit vector.
pub(crate) fn unit_normal_to(v: Vector3<f64>, axis: Vector3<f64>) -> Option<Vector3<f64>> {
    // One part in a hundred. Nearer than 0.6 degrees to the axis, noise alone would choose the direction.
    let normal = v - axis * axis.dot(&v);
    let length = normal.norm();
    (length > 1e-2 && length.is_finite()).then(|| normal / length)
}

/// Rotates `v` by the quaternion x y z w. The formula is even in its sign, so q and -q give the same bits.
pub(crate) fn rotate(q: [f32; 4], v: Vector3<f64>) -> Option<Vector3<f64>> {
    let u = Vector3::new(f64::from(q[0]), f64::from(q[1]), f64::from(q[2]));
    let w = f64::from(q[3]);
    let square = u.norm_squared() + w * w;
    if !(square > 0.5 && square < 2.0) {
        return None;
    }
    Some(v + (u.cross(&v) * w + u.cross(&u.cross(&v))) * (2.0 / square))
}

/// The inverse rotation of [`rotate`].
pub(crate) fn rotate_back(q: [f32; 4], v: Vector3<f64>) -> Option<Vector3<f64>> {
    rotate([-q[0], -q[1], -q[2], q[3]], v)
}

/// Rotates `v` by the smallest rotation that takes the unit vector `from` to the unit vector `to`.
pub(crate) fn carry(from: Vector3<f64>, to: Vector3<f64>, v: Vector3<f64>) -> Vector3<f64> {
    let cos = from.dot(&to);
    if cos < -0.999 {
        return v; // Opposite directions: no axis is better than another, and keeping the vector moves least.
    }
    let axis = from.cross(&to);
    v + axis.cross(&v) + axis.cross(&axis.cross(&v)) / (1.0 + cos)
}

/// Returns the quaternion x y z w, w >= 0, of a rotation matrix.
pub(crate) fn quaternion(m: &Matrix3<f64>) -> [f32; 4] {
    stored(&UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(*m)))
}

/// Returns x y z w, w >= 0, of a rotation.
pub(crate) fn stored(q: &UnitQuaternion<f64>) -> [f32; 4] {
    let sign = if q.w < 0.0 { -1.0 } else { 1.0 };
    [q.i, q.j, q.k, q.w].map(|c| (c * sign) as f32)
}

/// Spherical interpolation on the shorter arc from `a` (t = 0) to `b` (t = 1), both x y z w. Returns `a` if either
/// has no length.
pub fn slerp(a: [f32; 4], b: [f32; 4], t: f32) -> [f32; 4] {
    let read = |q: [f32; 4]| {
        let [x, y, z, w] = q.map(f64::from);
        UnitQuaternion::try_new(Quaternion::new(w, x, y, z), 1e-6)
    };
    let (Some(from), Some(to)) = (read(a), read(b)) else {
        return a;
    };
    let to = if from.coords.dot(&to.coords) < 0.0 { UnitQuaternion::new_unchecked(-to.into_inner()) } else { to };
    let q = from.try_slerp(&to, f64::from(t), 1e-9).unwrap_or(from);
    [q.i, q.j, q.k, q.w].map(|c| c as f32)
}
