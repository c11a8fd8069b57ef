//! Solves the arm from shoulder, elbow and wrist by geometry alone, and tries every branch. This is the
//! analytic baseline.
//!
//! Let Rot(a, t) be the rotation by t about a. Let U = R0 R1 R2 and F = U R3 R4. Let y be the bone axis of both
//! limbs in the T-pose. Let u and f be the directions shoulder-elbow and elbow-wrist of the human:
//!
//! 1. R0 R1 y = u places the elbow. a0.u = a0.Rot(a1, t1) y has two solutions t1. Then t0 turns Rot(a1, t1) y
//!    into u. Where t0 meets its limit, t1 is solved again for that t0.
//! 2. R2 R3 y = f' = (R0 R1)^-1 f places the wrist in the same way. There are two solutions t3, with the elbow
//!    bent one way or the other. t2 turns the elbow's plane into that of shoulder, elbow and wrist. A third
//!    candidate takes t2 from the human's own rotation about the upper arm. It matters where the elbow is
//!    straight and has no plane. Where t2 meets its limit, t3 is solved again.
//! 3. t4 is the remaining twist.
//!
//! The result is the one of the 2 x 3 postures, all within the limits, that has the least S_GR. If several are
//! equal, it is the one nearest to the previous posture.

use nalgebra::{UnitQuaternion, Vector3};
use retarget::{ARM_Q, ArmModel, ArmQ, Limbs};
use std::f64::consts::{PI, TAU};

/// Directions closer to an axis than this (sine of the angle) have no angle about it, rad.
const SINGULAR_SINE: f64 = 1e-4;
/// Postures whose S_GR differs by less are equally good: 0.1 degrees in one limb, sin^2(0.05 deg).
const EQUAL_S_GR: f64 = 7.6e-7;

/// Returns the joint positions of one arm, rad, within the limits. `previous` decides ties and singularities.
pub fn sew(arm: &ArmModel, human: &Limbs, previous: &ArmQ) -> ArmQ {
    let bends = [Bend::Plane(1.0), Bend::Plane(-1.0), Bend::Twist];
    let branches = [1.0, -1.0].into_iter().flat_map(|elbow_side| bends.map(|bend| (elbow_side, bend)));
    let solved = branches.map(|(elbow_side, bend)| {
        let q = branch(arm, human, previous, elbow_side, bend);
        let distance: f64 = q.iter().zip(previous).map(|(a, b)| (a - b) * (a - b)).sum();
        (arm.s_gr(&q, human), distance, q)
    });
    let best = solved.reduce(|best, next| {
        let equal = (next.0 - best.0).abs() < EQUAL_S_GR;
        if if equal { next.1 < best.1 } else { next.0 < best.0 } { next } else { best }
    });
    best.map_or_else(|| arm.mid(), |(_, _, q)| q)
}

/// Source of joint 3.
#[derive(Clone, Copy)]
enum Bend {
    /// The plane of shoulder, elbow and wrist, with the elbow bent to one side or the other.
    Plane(f64),
    /// The human's rotation about the upper arm.
    Twist,
}

fn branch(arm: &ArmModel, human: &Limbs, previous: &ArmQ, elbow_side: f64, bend: Bend) -> ArmQ {
    let [a0, a1, a2, a3, a4] = &arm.axes;
    let y = Vector3::y();
    let (u, f) = (human.upper * y, human.fore * y);
    let offset = |joint: usize, t: f64| within_limits(arm, joint, t);
    let before = |joint: usize| previous[joint] - arm.reference[joint];

    // The elbow.
    let (mut t1, _) = offset(1, polar(a0, a1, &y, &u, elbow_side));
    let (t0, at_limit) = offset(0, angle_about(a0, &(about(a1, t1) * y), &u).unwrap_or_else(|| before(0)));
    let shoulder_0 = about(a0, t0);
    if at_limit {
        (t1, _) = offset(1, angle_about(a1, &y, &(shoulder_0.inverse() * u)).unwrap_or(t1));
    }
    let shoulder = shoulder_0 * about(a1, t1);

    // The wrist.
    let f = shoulder.inverse() * f;
    let twist = || twist_about(a2, &(shoulder.inverse() * human.upper));
    let (t2, solved) = match bend {
        Bend::Plane(side) => {
            let (t3, _) = offset(3, polar(a2, a3, &y, &f, side));
            let (t2, at_limit) = offset(2, angle_about(a2, &(about(a3, t3) * y), &f).unwrap_or_else(twist));
            (t2, (!at_limit).then_some(t3))
        }
        Bend::Twist => (offset(2, twist()).0, None),
    };
    let roll = about(a2, t2);
    let t3 =
        solved.unwrap_or_else(|| offset(3, angle_about(a3, &y, &(roll.inverse() * f)).unwrap_or_else(|| before(3))).0);

    // The hand's side of the forearm.
    let elbow = shoulder * roll * about(a3, t3);
    let (t4, _) = offset(4, twist_about(a4, &(elbow.inverse() * human.fore)));
    let t = [t0, t1, t2, t3, t4];
    std::array::from_fn::<f64, ARM_Q, _>(|joint| arm.reference[joint] + t[joint])
}

/// Returns one of the two angles t about `turn` with pole.Rot(turn, t) from = pole.to. Without a solution it
/// returns the nearest angle. `pole` is orthogonal to `turn`.
fn polar(pole: &Vector3<f64>, turn: &Vector3<f64>, from: &Vector3<f64>, to: &Vector3<f64>, side: f64) -> f64 {
    let (cosine, sine) = (pole.dot(from), pole.dot(&turn.cross(from)));
    let reach = (pole.dot(to) / cosine.hypot(sine)).clamp(-1.0, 1.0);
    sine.atan2(cosine) + side * reach.acos()
}

fn about(axis: &Vector3<f64>, angle: f64) -> UnitQuaternion<f64> {
    UnitQuaternion::new(axis * angle)
}

/// Returns the angle about the unit `axis` that turns `from` as near to `to` as possible. None if one of them
/// lies along the axis.
fn angle_about(axis: &Vector3<f64>, from: &Vector3<f64>, to: &Vector3<f64>) -> Option<f64> {
    if axis.cross(from).norm() < SINGULAR_SINE || axis.cross(to).norm() < SINGULAR_SINE {
        return None;
    }
    let cosine = from.dot(to) - axis.dot(from) * axis.dot(to);
    Some(axis.dot(&from.cross(to)).atan2(cosine))
}

/// Returns the angle of the twist of `r` about the unit `axis` (swing-twist decomposition), rad.
fn twist_about(axis: &Vector3<f64>, r: &UnitQuaternion<f64>) -> f64 {
    2.0 * r.imag().dot(axis).atan2(r.w)
}

/// Returns the offset `t` from the reference, shifted by whole turns to the middle of the limits and clamped.
/// Also returns true if it was clamped.
fn within_limits(arm: &ArmModel, joint: usize, t: f64) -> (f64, bool) {
    let mid = 0.5 * (arm.q_min[joint] + arm.q_max[joint]);
    let q = mid + (t + arm.reference[joint] - mid + PI).rem_euclid(TAU) - PI;
    let clamped = q.max(arm.q_min[joint]).min(arm.q_max[joint]);
    (clamped - arm.reference[joint], clamped != q)
}
