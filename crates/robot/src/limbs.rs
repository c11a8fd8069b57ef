//! Rotations of limbs: conversion from messages, mirror images, interpolation and error.

use messages::LIMBS;
use nalgebra::{Quaternion, UnitQuaternion, Vector3};

/// Rotations of one arm's two limbs in the torso frame (x forward, y left, z up), as differences from the T-pose.
/// A right arm is mirrored to a left one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limbs {
    /// Shoulder to elbow.
    pub upper: UnitQuaternion<f64>,
    /// Elbow to wrist.
    pub fore: UnitQuaternion<f64>,
}

impl Limbs {
    /// The T-pose.
    pub fn identity() -> Self {
        Self { upper: UnitQuaternion::identity(), fore: UnitQuaternion::identity() }
    }

    /// Converts upper arm and forearm (x y z w) of the left (0) or the right (1) arm. `None` if one of them is no
    /// rotation.
    pub fn from_arm(arm: usize, limbs: [[f64; 4]; 2]) -> Option<Self> {
        let [upper, fore] = limbs.map(|limb| left_rotation(arm, limb));
        Some(Self { upper: upper?, fore: fore? })
    }

    /// Converts the limbs of both arms, indexed by `messages::Limb`. `None` if one of them is no rotation.
    pub fn from_message(limbs: &[[f32; 4]; LIMBS]) -> Option<[Self; 2]> {
        let [left_upper, left_fore, right_upper, right_fore] = limbs.map(|limb| limb.map(f64::from));
        Some([Self::from_arm(0, [left_upper, left_fore])?, Self::from_arm(1, [right_upper, right_fore])?])
    }

    /// Interpolates both limbs at `s` between `self` (0) and `other` (1), each along the shorter arc.
    pub fn slerp(&self, other: &Self, s: f64) -> Self {
        Self { upper: slerp(&self.upper, &other.upper, s), fore: slerp(&self.fore, &other.fore, s) }
    }

    /// The person's limbs as a target for these limbs of a robot. `rolls`: the limbs, upper arm and forearm, that the robot can turn
    /// about their own length. A limb that cannot roll is matched by its direction alone: the target points as the person's limb
    /// and has the robot's roll. It is R turned by the shortest rotation from R y to P y, with R of the robot, P of the person
    /// and y along the limb.
    #[inline]
    pub fn target(&self, person: &Self, rolls: [bool; 2]) -> Self {
        if rolls == [true; 2] {
            return *person;
        }
        let pointed = |rolls: bool, robot: &UnitQuaternion<f64>, person: &UnitQuaternion<f64>| {
            if rolls { *person } else { pointed_as(robot, person) }
        };
        Self { upper: pointed(rolls[0], &self.upper, &person.upper), fore: pointed(rolls[1], &self.fore, &person.fore) }
    }

    /// Directions of the limbs: upper arm, forearm.
    #[inline]
    pub fn directions(&self) -> [Vector3<f64>; 2] {
        [self.upper, self.fore].map(|limb| rotate(limb.quaternion(), &Vector3::y()))
    }

    /// Angles between these limbs and the person's, rad: upper arm, forearm.
    pub fn angles(&self, person: &Self) -> [f64; 2] {
        [(self.upper, person.upper), (self.fore, person.fore)].map(|(robot, person)| {
            let (w, v) = rotation_error(&robot, &person);
            2.0 * v.norm().atan2(w)
        })
    }

    /// As [`Limbs::slerp`], but keeps the quaternions' signs.
    pub fn between(&self, other: &Self, s: f64) -> Self {
        Self { upper: slerp_signed(&self.upper, &other.upper, s), fore: slerp_signed(&self.fore, &other.fore, s) }
    }
}

/// `robot` turned by the shortest rotation that lets it point as `person` does. Half a turn is about any axis across.
fn pointed_as(robot: &UnitQuaternion<f64>, person: &UnitQuaternion<f64>) -> UnitQuaternion<f64> {
    let [from, to] = [robot, person].map(|limb| rotate(limb.quaternion(), &Vector3::y()));
    let (w, v) = (1.0 + from.dot(&to), from.cross(&to));
    // The rotation by the angle a has w = 1 + cos a and |v| = sin a, up to a factor. At half a turn both vanish.
    let shortest = UnitQuaternion::try_new(Quaternion::new(w, v.x, v.y, v.z), 1e-9);
    shortest.unwrap_or_else(|| {
        UnitQuaternion::new_unchecked(axis_rotation(&rotate(robot.quaternion(), &Vector3::x()), std::f64::consts::PI))
    }) * robot
}

/// Two quaternions closer than this (1 - |dot|) are interpolated linearly. The error stays below 1e-12 rad, and no
/// division by the sine of a vanishing angle occurs.
const SLERP_LINEAR: f64 = 1e-8;

/// Rotation at `s` between `a` (0) and `b` (1) on the shorter arc. q and -q are the same rotation.
#[inline]
pub fn slerp(a: &UnitQuaternion<f64>, b: &UnitQuaternion<f64>, s: f64) -> UnitQuaternion<f64> {
    slerp_signed(a, &align(b, a), s)
}

/// Returns `q` or -q, the one nearer to `reference` on the sphere. Both are the same rotation.
#[inline]
pub fn align(q: &UnitQuaternion<f64>, reference: &UnitQuaternion<f64>) -> UnitQuaternion<f64> {
    if q.coords.dot(&reference.coords) < 0.0 { UnitQuaternion::new_unchecked(-q.into_inner()) } else { *q }
}

/// Slerp on the sphere that keeps the signs. It is continuous in all arguments while a and b are not opposite.
fn slerp_signed(a: &UnitQuaternion<f64>, b: &UnitQuaternion<f64>, s: f64) -> UnitQuaternion<f64> {
    let dot = a.coords.dot(&b.coords).clamp(-1.0, 1.0);
    if dot < SLERP_LINEAR - 1.0 {
        return if s < 0.5 { *a } else { *b };
    }
    let (wa, wb) = if dot > 1.0 - SLERP_LINEAR {
        (1.0 - s, s)
    } else {
        let angle = dot.acos();
        let sin = angle.sin();
        (((1.0 - s) * angle).sin() / sin, (s * angle).sin() / sin)
    };
    UnitQuaternion::new_normalize(Quaternion::from(a.coords * wa + b.coords * wb))
}

/// Rotates v by the unit quaternion q: v + 2 w (u x v) + 2 u x (u x v).
#[inline]
pub fn rotate(q: &Quaternion<f64>, v: &Vector3<f64>) -> Vector3<f64> {
    let u = Vector3::new(q.i, q.j, q.k);
    let t = u.cross(v) * 2.0;
    v + t * q.w + u.cross(&t)
}

/// Returns w and the imaginary part of q_robot q_human^-1, with w >= 0.
#[inline]
pub fn rotation_error(robot: &UnitQuaternion<f64>, human: &UnitQuaternion<f64>) -> (f64, Vector3<f64>) {
    let e = robot.quaternion() * human.quaternion().conjugate();
    let v = Vector3::new(e.i, e.j, e.k);
    if e.w < 0.0 { (-e.w, -v) } else { (e.w, v) }
}

/// Returns the quaternion of a rotation by `angle` (rad) about a unit axis.
#[inline]
pub fn axis_rotation(axis: &Vector3<f64>, angle: f64) -> Quaternion<f64> {
    let (sin, cos) = (0.5 * angle).sin_cos();
    Quaternion::new(cos, axis.x * sin, axis.y * sin, axis.z * sin)
}

/// Mirrors a limb rotation at the plane between left and right: (x, y, z, w) -> (-x, y, -z, w). It turns a right
/// arm into a left arm and back.
#[inline]
pub fn mirror(limb: [f64; 4]) -> [f64; 4] {
    [-limb[0], limb[1], -limb[2], limb[3]]
}

/// Returns the rotation x y z w of the left (0) or the right (1) arm, mirrored to a left arm. `None` if it is no rotation.
#[inline]
pub fn left_rotation(arm: usize, xyzw: [f64; 4]) -> Option<UnitQuaternion<f64>> {
    rotation_from_xyzw(if arm == 0 { xyzw } else { mirror(xyzw) })
}

/// Mirrors a rotation between a left arm and the left (0) or right (1) arm. It is its own inverse.
#[inline]
pub fn on_side(arm: usize, rotation: &UnitQuaternion<f64>) -> UnitQuaternion<f64> {
    if arm == 0 { *rotation } else { mirrored(rotation) }
}

/// Mirrors a place between the left arm and the left (0) or right (1) arm. It is its own inverse.
pub fn place_on_side(side: usize, v: Vector3<f64>) -> Vector3<f64> {
    if side == 0 { v } else { Vector3::new(v.x, -v.y, v.z) }
}

/// The same for an axis. A turn about it by the same angle is the mirror image.
pub fn axis_on_side(side: usize, axis: Vector3<f64>) -> Vector3<f64> {
    if side == 0 { axis } else { Vector3::new(-axis.x, axis.y, -axis.z) }
}

/// As [`mirror`], for a rotation.
#[inline]
pub fn mirrored(rotation: &UnitQuaternion<f64>) -> UnitQuaternion<f64> {
    UnitQuaternion::new_unchecked(Quaternion::new(rotation.w, -rotation.i, rotation.j, -rotation.k))
}

/// Largest deviation of a limb quaternion's squared norm from one. `ingest` normalises in f64, so a larger
/// deviation means no rotation.
const NORM_TOLERANCE: f64 = 1e-3;

/// Returns the rotation of x y z w. `None` if it is not finite or not of unit length.
pub fn rotation_from_xyzw(limb: [f64; 4]) -> Option<UnitQuaternion<f64>> {
    let squared: f64 = limb.iter().map(|c| c * c).sum();
    let unit = (squared - 1.0).abs() <= NORM_TOLERANCE;
    unit.then(|| UnitQuaternion::new_normalize(Quaternion::new(limb[3], limb[0], limb[1], limb[2])))
}

/// Returns x y z w of a rotation.
pub fn xyzw_from_rotation(rotation: &UnitQuaternion<f64>) -> [f64; 4] {
    let q = rotation.quaternion();
    [q.i, q.j, q.k, q.w]
}
