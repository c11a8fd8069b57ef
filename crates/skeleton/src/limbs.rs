//! Torso frame and limb frames from positions. Rotations are used for twist only: rest poses differ between
//! exporters, and positions do not.

use crate::geometry::{carry, quaternion, rotate, unit, unit_normal_to, vector};
use crate::reference::Reference;
use messages::{HingeCalibration, LIMBS, Limb, SMPL_JOINTS, Smpl, calibration_flag, skeleton_flag};
use nalgebra::{Matrix3, Vector3};

/// Lean of the line from the hips to the shoulders in a T-pose (rad). With it the torso frame of a T-pose is
/// upright. It is 5.7 degrees, measured on the T-pose at the start of CMU clip 007_12. The clip's hips are used,
/// not its spine joints, which lean by 10 to 17 degrees and differ from rig to rig.
pub const TORSO_LEAN_RAD: f64 = 0.1;
/// Below this flexion an elbow has no plane of its own, and only the held hinge is used: 5 degrees. Trackers'
/// noise of 5 mm on a forearm of 25 cm is 1 degree.
const STRAIGHT_SIN: f64 = 0.087;
/// From this flexion on only the measured plane is used: 15 degrees.
const FLEXED_SIN: f64 = 0.259;

/// Holds the hinge of each arm while its elbow is straight. It is used only without a calibration.
#[derive(Clone, Copy, Debug, Default)]
pub struct Hold {
    /// Left and right: upper-arm bone and hinge, in the torso frame.
    arms: [Option<(Vector3<f64>, Vector3<f64>)>; 2],
}

/// Limb frames of one instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LimbFrames {
    /// Rotations relative to the torso frame, as differences from the T-pose, x y z w with w >= 0, indexed by
    /// `Limb`. Identity if the limb is not valid.
    pub rotations: [[f32; 4]; LIMBS],
    /// Rotations of the left and the right hand, in the same way. A hand that continues its forearm has the forearm's.
    pub hands: [[f32; 4]; 2],
    /// Bits of `skeleton_flag`: the valid limbs and hands, and whether all valid limbs rest on a calibration.
    pub flags: u32,
}

impl LimbFrames {
    /// Four limbs and two hands, none of them valid.
    pub const NONE: Self =
        Self { rotations: [[0.0, 0.0, 0.0, 1.0]; LIMBS], hands: [[0.0, 0.0, 0.0, 1.0]; 2], flags: 0 };
}

/// Shoulder, elbow, wrist of both arms.
pub(crate) const ARMS: [[usize; 3]; 2] = [
    [Smpl::LeftShoulder as usize, Smpl::LeftElbow as usize, Smpl::LeftWrist as usize],
    [Smpl::RightShoulder as usize, Smpl::RightElbow as usize, Smpl::RightWrist as usize],
];
/// Upper arm and forearm of both arms.
const ARM_LIMBS: [[usize; 2]; 2] =
    [[Limb::LeftUpper as usize, Limb::LeftFore as usize], [Limb::RightUpper as usize, Limb::RightFore as usize]];

/// Returns the torso frame's axes as columns, in the frame of `positions`. y points from the right to the left
/// shoulder. z points from the hips to the shoulders and is upright in a T-pose (see [`TORSO_LEAN_RAD`]). `None`
/// if shoulders and hips coincide.
pub fn torso_rotation(positions: &[[f32; 3]; SMPL_JOINTS]) -> Option<Matrix3<f64>> {
    torso_rotation_leaning(positions, TORSO_LEAN_RAD)
}

/// As [`torso_rotation`], for a person who leans back by `lean_rad` when upright.
pub(crate) fn torso_rotation_leaning(positions: &[[f32; 3]; SMPL_JOINTS], lean_rad: f64) -> Option<Matrix3<f64>> {
    let at = |joint: Smpl| vector(positions[joint as usize]);
    let (left, right) = (at(Smpl::LeftShoulder), at(Smpl::RightShoulder));
    let spine = (left + right - at(Smpl::LeftHip) - at(Smpl::RightHip)) / 2.0;
    let y = unit(left - right)?;
    let back = unit_normal_to(unit(spine)?, y)?;
    let front = y.cross(&back);
    let (sin, cos) = lean_rad.sin_cos();
    Some(Matrix3::from_columns(&[front * cos - back * sin, y, front * sin + back * cos]))
}

/// Computes the four limb rotations of a person. For each limb it returns R with `bone = R (0, +-1, 0)` and `hinge
/// = R (0, 0, -+1)` (left and right) in the torso frame.
///
/// `positions` in m and `rotations` (global, x y z w) share any right-handed frame. A limb whose hinge is in
/// `calibration` and whose joint has a rotation takes its hinge from there. Every other limb takes the momentary
/// plane of the elbow. Near the straight elbow that plane is blended with `hold`. At the straight elbow the hinge
/// turns no further than the bone. A joint whose bit in `usable` is clear invalidates the limbs that need it.
pub fn limbs_from_positions_rotations(
    positions: &[[f32; 3]; SMPL_JOINTS],
    rotations: Option<&[[f32; 4]; SMPL_JOINTS]>,
    calibration: &HingeCalibration,
    usable: u32,
    hold: &mut Hold,
) -> LimbFrames {
    limbs_against(positions, rotations, &Reference::from_hinges(*calibration), usable, hold)
}

/// As [`limbs_from_positions_rotations`]. Each hinge counts by its weight against the momentary plane.
pub(crate) fn limbs_against(
    positions: &[[f32; 3]; SMPL_JOINTS],
    rotations: Option<&[[f32; 4]; SMPL_JOINTS]>,
    reference: &Reference,
    usable: u32,
    hold: &mut Hold,
) -> LimbFrames {
    let Reference { hinges: calibration, weight, hands, torso_lean_rad } = reference;
    let mut out = LimbFrames::NONE;
    let has = |joint: usize| usable & (1 << joint) != 0;
    let trunk = [Smpl::LeftShoulder, Smpl::RightShoulder, Smpl::LeftHip, Smpl::RightHip];
    if !trunk.iter().all(|&joint| has(joint as usize)) {
        return out;
    }
    let Some(world_from_torso) = torso_rotation_leaning(positions, *torso_lean_rad) else {
        return out;
    };
    let mut all_calibrated = true;
    for (side, joints) in ARMS.iter().enumerate() {
        let [shoulder, elbow, wrist] = *joints;
        let bone = |from: usize, to: usize| {
            let bone = unit(vector(positions[to]) - vector(positions[from]))?;
            (has(from) && has(to)).then(|| world_from_torso.tr_mul(&bone))
        };
        let Some(upper) = bone(shoulder, elbow) else { continue };
        let fore = bone(elbow, wrist);
        let hinge = |limb: usize, carrier: usize| {
            let valid = calibration.flags & calibration_flag::LIMB[limb] != 0 && has(carrier);
            let axis = rotate(rotations.filter(|_| valid)?[carrier], vector(calibration.hinge[limb]))?;
            Some(world_from_torso.tr_mul(&axis))
        };
        let momentary = momentary_hinge(&mut hold.arms[side], side, upper, fore);
        let [upper_limb, fore_limb] = ARM_LIMBS[side];
        let calibrated = hinge(upper_limb, shoulder).and_then(|axis| unit_normal_to(axis, upper));
        all_calibrated &= calibrated.is_some() && weight[upper_limb] >= 1.0;
        let upper_hinge = calibrated.map_or(momentary, |axis| blended(momentary, axis, weight[upper_limb], upper));
        out.rotations[upper_limb] = limb_rotation(side, upper, upper_hinge);
        out.flags |= skeleton_flag::LIMB[upper_limb];
        let Some(fore) = fore else { continue };
        let calibrated = hinge(fore_limb, wrist).and_then(|axis| unit_normal_to(axis, fore));
        all_calibrated &= calibrated.is_some() && weight[fore_limb] >= 1.0;
        let fallback = unit_normal_to(upper_hinge, fore);
        let fore_hinge = match (calibrated, fallback) {
            (Some(axis), Some(momentary)) => blended(momentary, axis, weight[fore_limb], fore),
            (Some(axis), None) | (None, Some(axis)) => axis,
            (None, None) => continue,
        };
        out.rotations[fore_limb] = limb_rotation(side, fore, fore_hinge);
        out.flags |= skeleton_flag::LIMB[fore_limb];
        // A hand without a hinge of full weight would be twisted against its forearm.
        let known = calibrated.is_some() && weight[fore_limb] >= 1.0;
        let Some(straight) = hands[side].filter(|_| known) else { continue };
        let pointing =
            rotations.and_then(|all| rotate(all[wrist], straight)).map(|axis| world_from_torso.tr_mul(&axis));
        let Some(bone) = pointing else { continue };
        let Some(hinge) = hinge(fore_limb, wrist).and_then(|axis| unit_normal_to(axis, bone)) else { continue };
        out.hands[side] = limb_rotation(side, bone, hinge);
        out.flags |= skeleton_flag::HAND[side];
    }
    if out.flags & skeleton_flag::ALL != 0 && all_calibrated {
        out.flags |= skeleton_flag::CALIBRATED;
    }
    out
}

/// Blends the momentary hinge (`weight` 0) and the calibrated one (1), both normal to `bone`.
fn blended(momentary: Vector3<f64>, calibrated: Vector3<f64>, weight: f64, bone: Vector3<f64>) -> Vector3<f64> {
    if weight >= 1.0 {
        return calibrated;
    }
    let nearer = if weight >= 0.5 { calibrated } else { momentary };
    unit_normal_to(calibrated * weight + momentary * (1.0 - weight), bone).unwrap_or(nearer)
}

/// Returns the hinge of the elbow's present plane, or the held one if the elbow is straight. It is always normal
/// to `upper`.
fn momentary_hinge(
    held: &mut Option<(Vector3<f64>, Vector3<f64>)>,
    side: usize,
    upper: Vector3<f64>,
    fore: Option<Vector3<f64>>,
) -> Vector3<f64> {
    let sign = if side == 0 { 1.0 } else { -1.0 };
    let (bone, axis) = held.unwrap_or((Vector3::y() * sign, Vector3::z() * -sign));
    let kept = carry(bone, upper, axis);
    let kept = unit_normal_to(kept, upper).or_else(|| unit_normal_to(Vector3::x(), upper)).unwrap_or(axis);
    let normal = fore.map_or_else(Vector3::zeros, |fore| upper.cross(&fore));
    let sin = normal.norm();
    let t = ((sin - STRAIGHT_SIN) / (FLEXED_SIN - STRAIGHT_SIN)).clamp(0.0, 1.0);
    let weight = t * t * (3.0 - 2.0 * t);
    let measured = unit(normal).unwrap_or(kept);
    let hinge = unit_normal_to(measured * weight + kept * (1.0 - weight), upper).unwrap_or(kept);
    *held = Some((upper, hinge));
    hinge
}

/// Returns the limb's rotation. On the left its y column is along the bone and its z column against the hinge. On
/// the right both are reversed.
fn limb_rotation(side: usize, bone: Vector3<f64>, hinge: Vector3<f64>) -> [f32; 4] {
    let (y, z) = if side == 0 { (bone, -hinge) } else { (-bone, hinge) };
    quaternion(&Matrix3::from_columns(&[y.cross(&z), y, z]))
}
