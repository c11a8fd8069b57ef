//! An arm from shoulder and wrist alone: the elbow by two bones of known length, in closed form.
//!
//! With the bones a and b and the distance L from shoulder to wrist, the elbow is at s + x u + sqrt(a^2 - x^2) n, x =
//! (a^2 - b^2 + L^2) / 2L. u points to the wrist and n is normal to u. Everything is in the axes of WebXR.

use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};

/// Largest share of the arm's length. A straight arm keeps a little bend, which shows the elbow's axis.
const STRAIGHT: f64 = 0.999;
/// Smallest distance from shoulder to wrist beyond the difference of the bones, m. Assumption: no arm folds further.
const FOLDED_M: f64 = 0.02;
/// Slope of the elbow of an arm that points ahead: this far outwards for one down. It is 25 degrees. Assumption.
const OUTWARDS: f64 = 0.466;
/// Cosine at which two directions count as opposite, as in `skeleton`.
const OPPOSITE: f64 = -0.999;

/// Joints of an arm and their rotations. A rotation is the identity in a T-pose that looks along -z.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Arm {
    pub(super) elbow: Vector3<f64>,
    /// On the line to the given wrist, no further than the bones reach. So the bones keep their lengths.
    pub(super) wrist: Vector3<f64>,
    pub(super) upper: UnitQuaternion<f64>,
    pub(super) fore: UnitQuaternion<f64>,
}

/// Axis of the elbow of the left (0) or right (1) arm in the frames of a T-pose.
pub(super) fn hinge(side: usize) -> Vector3<f64> {
    if side == 0 { -Vector3::y() } else { Vector3::y() }
}

/// Solves the arm of this side. `torso` is the rotation of the trunk. The elbow of an arm that points ahead hangs down and a
/// little outwards. Other arms carry it along the shortest turn from there: it points back in an arm that hangs, and ahead
/// in a raised one. Only an arm that points straight back has no such turn.
pub(super) fn solve(
    side: usize,
    torso: &UnitQuaternion<f64>,
    shoulder: Vector3<f64>,
    wrist: Vector3<f64>,
    [a, b]: [f64; 2],
) -> Arm {
    let ahead = torso * -Vector3::z();
    let outwards = torso * if side == 0 { -Vector3::x() } else { Vector3::x() };
    let hanging = (-Vector3::y() + outwards * OUTWARDS).normalize();
    let line = wrist - shoulder;
    let distance = line.norm();
    let along = if distance > 1e-6 { line / distance } else { ahead };
    let length = distance.clamp((a - b).abs() + FOLDED_M, (a + b) * STRAIGHT);
    let x = (a * a - b * b + length * length) / (2.0 * length);
    let aside = (a * a - x * x).max(0.0).sqrt();
    let elbow = shoulder + along * x + carry(ahead, along, hanging) * aside;
    let wrist = shoulder + along * length;
    let (upper, fore) = ((elbow - shoulder) / a, (wrist - elbow) / b);
    let axis = upper.cross(&fore).normalize();
    Arm { elbow, wrist, upper: turned(side, upper, axis), fore: turned(side, fore, axis) }
}

/// Rotates `v` by the smallest rotation that takes the unit vector `from` to the unit vector `to`.
fn carry(from: Vector3<f64>, to: Vector3<f64>, v: Vector3<f64>) -> Vector3<f64> {
    let cos = from.dot(&to);
    if cos < OPPOSITE {
        return (v - to * to.dot(&v)).normalize();
    }
    let axis = from.cross(&to);
    v + axis.cross(&v) + axis.cross(&axis.cross(&v)) / (1.0 + cos)
}

/// Returns the rotation from the T-pose that takes the arm's direction to `bone` and its hinge to `axis`.
fn turned(side: usize, bone: Vector3<f64>, axis: Vector3<f64>) -> UnitQuaternion<f64> {
    let rest = if side == 0 { -Vector3::x() } else { Vector3::x() };
    let from = Matrix3::from_columns(&[rest, hinge(side), rest.cross(&hinge(side))]);
    let to = Matrix3::from_columns(&[bone, axis, bone.cross(&axis)]);
    UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(to * from.transpose()))
}

#[cfg(test)]
mod tests {
    use super::*;

    const BONES: [f64; 2] = [0.33, 0.26];

    fn wrists() -> Vec<Vector3<f64>> {
        let mut all = Vec::new();
        for n in 0..400 {
            let (turn, height) = (2.4 * f64::from(n), -0.98 + 1.96 * f64::from(n) / 399.0);
            let flat = (1.0_f64 - height * height).sqrt();
            let distance = [0.0, 0.05, 0.2, 0.4, 0.58, 0.59, 2.0][n as usize % 7];
            all.push(Vector3::new(flat * turn.cos(), height, flat * turn.sin()) * distance);
        }
        all
    }

    #[test]
    fn elbow_keeps_bones_and_direction_of_the_wrist() {
        let (shoulder, torso) = (Vector3::new(0.2, 1.4, -0.3), UnitQuaternion::from_euler_angles(0.0, 0.7, 0.0));
        for side in 0..2 {
            for wrist in wrists() {
                let arm = solve(side, &torso, shoulder, shoulder + wrist, BONES);
                let (upper, fore) = (arm.elbow - shoulder, arm.wrist - arm.elbow);
                assert!((upper.norm() - BONES[0]).abs() < 1e-9 && (fore.norm() - BONES[1]).abs() < 1e-9, "{wrist}");
                let reached = arm.wrist - shoulder;
                assert!(wrist.norm() == 0.0 || reached.cross(&wrist).norm() < 1e-9 && reached.dot(&wrist) > 0.0);
                if (0.1..0.58).contains(&wrist.norm()) {
                    assert!((reached - wrist).norm() < 1e-9, "a wrist in reach stays where it is");
                }
            }
        }
    }

    /// The forward geometry of an arm whose elbow lies where the prior says.
    #[test]
    fn elbow_of_a_known_posture_is_found() {
        let (torso, down) = (UnitQuaternion::identity(), (-Vector3::y() + Vector3::x() * OUTWARDS).normalize());
        for bend in [0.2_f64, 0.8, 1.4] {
            let elbow = -Vector3::z() * (BONES[0] * bend.cos()) + down * (BONES[0] * bend.sin());
            // The wrist lies straight ahead of the shoulder.
            let ahead = BONES[0] * bend.cos() + (BONES[1].powi(2) - (BONES[0] * bend.sin()).powi(2)).max(0.0).sqrt();
            if (BONES[0] * bend.sin()) < BONES[1] {
                let arm = solve(1, &torso, Vector3::zeros(), -Vector3::z() * ahead, BONES);
                assert!((arm.elbow - elbow).norm() < 1e-9, "{bend}: {}", arm.elbow);
            }
        }
        let hanging = solve(0, &torso, Vector3::zeros(), -Vector3::y() * 0.5, BONES);
        assert!(hanging.elbow.z > 0.05, "it points back: {}", hanging.elbow);
        let raised = solve(0, &torso, Vector3::zeros(), Vector3::y() * 0.5, BONES);
        assert!(raised.elbow.z < -0.05, "it points ahead: {}", raised.elbow);
    }

    #[test]
    fn right_arm_mirrors_left_arm() {
        let flip = |v: Vector3<f64>| Vector3::new(-v.x, v.y, v.z);
        for wrist in wrists() {
            let left = solve(0, &UnitQuaternion::identity(), Vector3::zeros(), wrist, BONES);
            let right = solve(1, &UnitQuaternion::identity(), Vector3::zeros(), flip(wrist), BONES);
            // At the zero distance the arm points ahead in both.
            assert!((flip(left.elbow) - right.elbow).norm() < 1e-9, "{wrist}");
        }
    }

    #[test]
    fn rotations_carry_bones_and_hinge() {
        for (side, rest) in [(0, -Vector3::x()), (1, Vector3::x())] {
            for wrist in wrists() {
                let arm = solve(side, &UnitQuaternion::identity(), Vector3::zeros(), wrist, BONES);
                let (upper, fore) = (arm.elbow.normalize(), (arm.wrist - arm.elbow).normalize());
                assert!((arm.upper * rest - upper).norm() < 1e-6 && (arm.fore * rest - fore).norm() < 1e-6);
                assert!((arm.upper * hinge(side) - upper.cross(&fore).normalize()).norm() < 1e-6);
            }
        }
        let t_pose = solve(0, &UnitQuaternion::identity(), Vector3::zeros(), -Vector3::x(), BONES);
        assert!(t_pose.upper.angle() < 1.6, "{}", t_pose.upper.angle());
    }
}
