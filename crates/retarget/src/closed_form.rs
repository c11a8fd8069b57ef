//! Solves the four limbs by geometry alone, then clamps. It is the baseline, and a start for the refinement.

use std::f64::consts::{PI, TAU};

use nalgebra::{UnitQuaternion, Vector3};

use crate::arm::{ARM_Q, ArmModel, ArmQ};
use crate::refine::{PRIOR_WEIGHT, distance, refine};
use robot::Limbs;

/// Below this sine of the angle between upper arm axis and first joint axis, the split between joints 1 and 3 is
/// held: the gimbal. The hold costs a limb error of at most this angle, rad.
const GIMBAL_SINE: f64 = 1e-4;
/// Branches whose S_GR differs by less than this are equally good: 0.1 degrees in one limb, sin^2(0.05 deg). Then
/// the one nearer to the previous posture is taken.
const EQUAL_S_GR: f64 = 7.6e-7;

/// Postures from which an arm without a closed form is searched.
const SPREAD_STARTS: u32 = 16;
/// Steps of each search.
const SEARCH_STEPS: u32 = 8;
/// Weight of the distance from the previous posture in a search, as a share of the refinement's. Joints that matter little stay.
const SEARCH_PRIOR: f64 = 0.01;

/// Closed-form joint positions of one arm, rad, within the limits. The shoulder is a product of three rotations
/// about axes that are orthogonal in sequence, so it has two branches. The elbow is the best product of two, given
/// the clamped shoulder. The branch with the smaller S_GR after clamping is taken. If both are equally good, it is
/// the one nearer to `previous`. At the gimbal the arm is parallel to the first axis. There joint 1 keeps its
/// `previous` value, and joint 3 takes the rest. An arm without this form is searched; see [`ArmModel::has_closed_form`].
pub fn closed_form(arm: &ArmModel, human: &Limbs, previous: &ArmQ) -> ArmQ {
    if !arm.has_closed_form {
        return searched(arm, human, previous);
    }
    let mut best = branch(arm, human, previous, 1.0);
    let other = branch(arm, human, previous, -1.0);
    let (s_best, s_other) = (arm.s_gr(&best, human), arm.s_gr(&other, human));
    let nearer = distance(&other, previous) < distance(&best, previous);
    if s_other + EQUAL_S_GR < s_best || (s_other < s_best + EQUAL_S_GR && nearer) {
        best = other;
    }
    best
}

/// The best of short refinements from `previous` and from postures that are spread over the ranges. Of those that are equally
/// good, it is the one nearest to `previous`.
fn searched(arm: &ArmModel, human: &Limbs, previous: &ArmQ) -> ArmQ {
    // Each bit puts one of the first four joints at a quarter or at three quarters of its range. The last one is of slot 3, which
    // is empty if the upper arm cannot roll.
    let starts = SPREAD_STARTS >> u32::from(!arm.rolls[0]);
    let (mid, half) = (arm.mid(), arm.half());
    let spread = (0..starts).map(|bits: u32| {
        std::array::from_fn(|j| {
            mid[j] + half[j] * [-0.5, 0.5, 0.0][if j < 4 { (bits >> [0, 1, 3, 2][j] & 1) as usize } else { 2 }]
        })
    });
    let end = |start: ArmQ| refine(arm, human, &start, previous, PRIOR_WEIGHT * SEARCH_PRIOR, SEARCH_STEPS);
    let best = spread.map(end).fold(end(*previous), |best, next| {
        let nearer = distance(&next.q, previous) < distance(&best.q, previous);
        let equal = (next.s_gr - best.s_gr).abs() <= EQUAL_S_GR;
        if (equal && nearer) || (!equal && next.s_gr < best.s_gr) { next } else { best }
    });
    best.q
}

/// Solves one branch of [`closed_form`]: that on one side of the gimbal (`sign` 1 or -1 of the second joint's offset from
/// it).
pub fn branch(arm: &ArmModel, human: &Limbs, previous: &ArmQ, sign: f64) -> ArmQ {
    let mut q = [0.0; ARM_Q];
    let shoulder = shoulder(arm, &human.upper, previous, sign);
    for j in 0..3 {
        q[j] = into_limits(arm, j, shoulder[j] + arm.reference[j]);
    }
    let upper = arm.forward(&[q[0], q[1], q[2], arm.reference[3], arm.reference[4]]).upper;
    let elbow = elbow(arm, &(upper.inverse() * human.fore), previous);
    for j in 3..ARM_Q {
        q[j] = into_limits(arm, j, elbow[j - 3] + arm.reference[j]);
    }
    q
}

/// Offsets t with R = Rot(a, t0) Rot(b, t1) Rot(c, t2), a and c orthogonal to b. a.Rc = (a.c) cos t1 + a.(b x c) sin t1
/// gives t1 up to its branch. t0 turns Rot(b, t1) c into Rc about a. t2 follows likewise from the transpose.
fn shoulder(arm: &ArmModel, r: &UnitQuaternion<f64>, previous: &ArmQ, sign: f64) -> [f64; 3] {
    let [a, b, c] = [&arm.axes[0], &arm.axes[1], &arm.axes[2]];
    let (cosine, sine) = (a.dot(c), a.dot(&b.cross(c)));
    let rc = r * c;
    let reach = (a.dot(&rc) / cosine.hypot(sine)).clamp(-1.0, 1.0);
    let t1 = sine.atan2(cosine) + sign * reach.acos();
    let from = UnitQuaternion::new(b * t1) * c;
    let t0 =
        if from.cross(a).norm() < GIMBAL_SINE { previous[0] - arm.reference[0] } else { angle_about(a, &from, &rc) };
    let rest = UnitQuaternion::new(b * -t1) * UnitQuaternion::new(a * -t0) * r;
    [t0, t1, twist_about(c, &rest)]
}

/// Offsets t that maximise <Rot(a, t0) Rot(b, t1), E> for orthogonal a and b. The scalar product is bilinear in
/// the half angles, so it splits into their sum and their difference.
fn elbow(arm: &ArmModel, e: &UnitQuaternion<f64>, previous: &ArmQ) -> [f64; 2] {
    let [a, b] = [&arm.axes[3], &arm.axes[4]];
    let v = e.imag();
    let (m00, m01, m10, m11) = (e.w, v.dot(b), v.dot(a), v.dot(&a.cross(b)));
    let half_before = [0.5 * (previous[3] - arm.reference[3]), 0.5 * (previous[4] - arm.reference[4])];
    let angle = |y: f64, x: f64, before: f64| if y.hypot(x) < GIMBAL_SINE { before } else { y.atan2(x) };
    let sum = angle(m10 + m01, m00 - m11, half_before[0] + half_before[1]);
    let difference = angle(m10 - m01, m00 + m11, half_before[0] - half_before[1]);
    [sum + difference, sum - difference]
}

/// Angle about the unit `axis` that turns `from` into `to`, rad.
fn angle_about(axis: &Vector3<f64>, from: &Vector3<f64>, to: &Vector3<f64>) -> f64 {
    let cosine = from.dot(to) - axis.dot(from) * axis.dot(to);
    axis.dot(&from.cross(to)).atan2(cosine)
}

/// Angle of the twist of `r` about the unit `axis` (swing-twist decomposition), rad.
fn twist_about(axis: &Vector3<f64>, r: &UnitQuaternion<f64>) -> f64 {
    2.0 * r.imag().dot(axis).atan2(r.w)
}

/// Shifts `angle` by whole turns to the middle of the limits, then clamps it, rad.
fn into_limits(arm: &ArmModel, joint: usize, angle: f64) -> f64 {
    let mid = 0.5 * (arm.q_min[joint] + arm.q_max[joint]);
    let shifted = mid + (angle - mid + PI).rem_euclid(TAU) - PI;
    shifted.max(arm.q_min[joint]).min(arm.q_max[joint])
}
