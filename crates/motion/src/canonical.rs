//! Converts a file's unit and axes to metres, x forward, y left, z up. Guesses them if the format does not say.

use crate::bvh::RigFrame;
use crate::{Frame, Guesses};
use messages::Smpl;
use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};

/// Units that exporters use, m. The last one is CMU's own unit (the cgspeed release): 0.45 inch divided by
/// 0.2025.
const UNITS: [(&str, f64); 5] = [("m", 1.0), ("cm", 0.01), ("mm", 0.001), ("inch", 0.0254), ("CMU unit", 0.056_444)];
/// Range of a person's stature, m. No two of the units fit into it at once.
const STATURE_M: [f64; 2] = [1.2, 2.2];
/// Nominal stature, m. A person in no plausible unit is scaled to it.
const STATURE_NOMINAL_M: f64 = 1.75;
/// Leg and spine as a share of the stature: hip to ankle 0.491, pelvis to head joint 0.39 (Winter, Biomechanics,
/// 4th ed., fig. 4.1, head joint at the skull's base).
const LEG_AND_SPINE_OF_STATURE: f64 = 0.88;
/// Number of frames used to guess the up-axis.
const UP_SAMPLES: usize = 200;
/// Time at the start of a clip that shows how the person stands, s. Later they may lie down.
const STANDS_S: f64 = 1.0;
/// Least cosine between the trunk of a rest pose and the vector from its ankles to its head: 30 degrees.
const ALONG: f64 = 0.87;
/// Least height over the floor of a lying person's pelvis, and largest height of any part, as shares of the stature. Assumptions.
const LIES: [f64; 2] = [0.03, 0.35];
/// Largest height of the ankles of a person who stands on the floor, as a share of the stature. Assumption: three times a foot's.
const ANKLES: f64 = 0.15;

/// The axis that points up in a format or a file of arrays.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Up {
    /// y.
    Y,
    /// z.
    Z,
}

impl std::str::FromStr for Up {
    type Err = &'static str;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        match text {
            "y" => Ok(Self::Y),
            "z" => Ok(Self::Z),
            _ => Err("is y or z"),
        }
    }
}

/// Transform into the canonical frame.
#[derive(Debug)]
pub(crate) struct Canonical {
    pub(crate) scale: f64,
    pub(crate) unit: &'static str,
    pub(crate) stature_m: f64,
    pub(crate) up: &'static str,
    pub(crate) warning: Option<String>,
    rotation: UnitQuaternion<f64>,
    shift: Vector3<f64>,
}

impl Canonical {
    /// Guesses everything that BVH leaves open. `rest` is the hierarchy without rotations. The error is the length of legs and
    /// spine, returned if they have none.
    pub(crate) fn guess(
        rest: &RigFrame,
        frames: &[RigFrame],
        rate_hz: f64,
        root_offset: [f64; 3],
    ) -> Result<Self, f64> {
        let (scale, unit, stature_m) = guess_unit(frames)?;
        let (axis, up, mut warning) = guess_up(Some(rest), frames, rate_hz);
        let mut rotation = canonical_from_file(axis);
        if up != "+Y" {
            rotation = face_forward(frames, &rotation) * rotation;
        }
        let shift = guess_shift(frames, &rotation, Vector3::from(root_offset));
        if unit == "scaled to 1.75 m" {
            warning = Some("no unit gives a plausible stature: scaled to 1.75 m".to_owned());
        }
        let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(rotation));
        Ok(Self { scale, unit, stature_m, up, warning, rotation, shift })
    }

    /// For formats with a known up-axis. If another axis looks more like it, this is a warning. The error is the
    /// length of legs and spine, returned if they have none.
    pub(crate) fn known(frames: &[RigFrame], rate_hz: f64, up: Up) -> Result<Self, f64> {
        let (scale, unit, stature_m) = guess_unit(frames)?;
        let (axis, up) = match up {
            Up::Y => (Vector3::y(), "+Y"),
            Up::Z => (Vector3::z(), "+Z"),
        };
        let looks = guess_up(None, frames, rate_hz).1;
        let warning = match unit {
            "m" if looks == up => None,
            "m" => Some(format!(
                "the person stands along {looks}, though {up} is taken as up (--up y and --up z change it)"
            )),
            _ => Some(format!("limb lengths in metres are implausible: uses unit {unit}")),
        };
        let mut rotation = canonical_from_file(axis);
        if up == "+Z" {
            rotation = face_forward(frames, &rotation) * rotation;
        }
        let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(rotation));
        Ok(Self { scale, unit, stature_m, up, warning, rotation, shift: Vector3::zeros() })
    }

    /// Returns the guesses with these warnings.
    pub(crate) fn guesses(&self, warnings: Vec<String>) -> Guesses {
        let (scale_m_per_unit, unit, stature_m, up) = (self.scale, self.unit, self.stature_m, self.up);
        Guesses { scale_m_per_unit, unit, stature_m, up, warnings, lost: None }
    }

    pub(crate) fn apply(&self, frame: &RigFrame) -> Frame {
        let mut out = Frame::ZERO;
        for (joint, pose) in frame.iter().enumerate() {
            let p = self.rotation * (pose.position + self.shift) * self.scale;
            // Rounding alone makes products of many rotations drift from unit length.
            let q = UnitQuaternion::new_normalize((self.rotation * pose.rotation).into_inner());
            out.positions[joint] = [p.x as f32, p.y as f32, p.z as f32];
            out.rotations[joint] = [q.i as f32, q.j as f32, q.k as f32, q.w as f32];
        }
        out
    }
}

/// Returns the scale (m per unit), its name, and the stature (m), from the bone lengths in the first frame.
fn guess_unit(frames: &[RigFrame]) -> Result<(f64, &'static str, f64), f64> {
    let stature = stature_m(frames.first().ok_or(0.0)?);
    if !stature.is_finite() || stature < 1e-6 {
        return Err(stature * LEG_AND_SPINE_OF_STATURE);
    }
    let plausible = |scale: f64| (STATURE_M[0]..=STATURE_M[1]).contains(&(stature * scale));
    Ok(match UNITS.into_iter().find(|&(_, scale)| plausible(scale)) {
        Some((unit, scale)) => (scale, unit, stature * scale),
        None => (STATURE_NOMINAL_M / stature, "scaled to 1.75 m", STATURE_NOMINAL_M),
    })
}

/// Returns the stature computed from the bone lengths in `frame`, in the frame's unit.
pub(crate) fn stature_m(frame: &RigFrame) -> f64 {
    use Smpl::{
        Head, LeftAnkle, LeftHip, LeftKnee, Neck, Pelvis, RightAnkle, RightHip, RightKnee, Spine1, Spine2, Spine3,
    };
    let chain = |joints: &[Smpl]| -> f64 {
        joints.windows(2).map(|w| (frame[w[1] as usize].position - frame[w[0] as usize].position).norm()).sum()
    };
    let legs = (chain(&[LeftHip, LeftKnee, LeftAnkle]) + chain(&[RightHip, RightKnee, RightAnkle])) / 2.0;
    (legs + chain(&[Pelvis, Spine1, Spine2, Spine3, Neck, Head])) / LEG_AND_SPINE_OF_STATURE
}

/// Returns the axis that points up, its name, and a warning if it is a guess.
///
/// The hierarchy's rest pose tells it, if a person stands in it. Some exporters turn the root against it by a quarter, always. So
/// if the first frame's pelvis is turned onto another axis, that axis counts. It does not if the person begins upside down, or if
/// the legs still stand along the rest pose's axis. Nor does it if the person lies over its floor, or stands along it more often.
/// Without such a rest pose the first second tells it, and then the whole clip.
fn guess_up(
    rest: Option<&RigFrame>,
    frames: &[RigFrame],
    rate_hz: f64,
) -> (Vector3<f64>, &'static str, Option<String>) {
    let rest = rest.filter(|rest| stands(rest)).zip(frames.first());
    let by_rest = rest.and_then(|(rest, first)| {
        let axis = main_axis(above_ankles(rest, Smpl::Head))?;
        let pelvis =
            |frame: &RigFrame| main_axis(frame[Smpl::Pelvis as usize].rotation * above_ankles(rest, Smpl::Head));
        let legs = |frame: &RigFrame| main_axis(above_ankles(frame, Smpl::Pelvis));
        let stands = |axis| sampled(frames).filter(|&frame| [pelvis(frame), legs(frame)] == [Some(axis); 2]).count();
        let Some(turned) = pelvis(first) else { return Some(axis).filter(|axis| legs(first) == Some(*axis)) };
        let holds = turned == axis
            || turned == -axis
            || legs(first) == Some(axis)
            || lies(frames, &axis, &turned)
            || stands(axis) > stands(turned);
        Some(if holds { axis } else { turned })
    });
    let mean = |frames: &[RigFrame]| {
        main_axis(sampled(frames).filter_map(|frame| above_ankles(frame, Smpl::Head).try_normalize(1e-9)).sum())
    };
    let start = &frames[..frames.len().min((STANDS_S * rate_hz).ceil().max(2.0) as usize)];
    let found = by_rest.or_else(|| mean(start)).or_else(|| mean(frames));
    let names = [["+X", "-X"], ["+Y", "-Y"], ["+Z", "-Z"]];
    match found {
        Some(axis) => (axis, names[axis.iamax()][usize::from(axis.sum() < 0.0)], None),
        // Most exporters use Y.
        None => (
            Vector3::y(),
            "+Y",
            Some("the person stands upright neither at the start nor on average: uses +Y as up".to_owned()),
        ),
    }
}

/// The vector from the middle of the ankles to a joint.
fn above_ankles(frame: &RigFrame, joint: Smpl) -> Vector3<f64> {
    let at = |joint: Smpl| frame[joint as usize].position;
    at(joint) - (at(Smpl::LeftAnkle) + at(Smpl::RightAnkle)) / 2.0
}

/// The axis nearest to a direction, within 45 degrees. `None` if none is near, or there is no direction.
fn main_axis(direction: Vector3<f64>) -> Option<Vector3<f64>> {
    let axis = direction.iamax();
    let is_within = direction.norm() > 0.0 && direction[axis].abs() >= 0.7 * direction.norm();
    is_within.then(|| Vector3::ith(axis, direction[axis].signum()))
}

/// Returns true if legs and trunk are one line, and the hips have a breadth. Rigs whose bones all lie along one axis have none.
fn stands(rest: &RigFrame) -> bool {
    let at = |joint: Smpl| rest[joint as usize].position;
    let unit = |vector: Vector3<f64>| vector.try_normalize(1e-9).unwrap_or_default();
    let (trunk, whole) = (unit(at(Smpl::Head) - at(Smpl::Pelvis)), above_ankles(rest, Smpl::Head));
    let across = at(Smpl::LeftHip) - at(Smpl::RightHip);
    trunk.dot(&unit(whole)) > ALONG && across.norm() > 0.05 * whole.norm() && unit(across).dot(&trunk).abs() < 0.5
}

/// Returns some frames from the whole clip.
fn sampled(frames: &[RigFrame]) -> impl Iterator<Item = &RigFrame> {
    frames.iter().step_by(frames.len().div_ceil(UP_SAMPLES).max(1))
}

/// Returns true if the pelvis begins over the plane through the origin with this normal, and nothing is ever below. The person
/// also begins low over it, or does not stand on the plane with the normal `turned`.
fn lies(frames: &[RigFrame], axis: &Vector3<f64>, turned: &Vector3<f64>) -> bool {
    let first = &frames[0];
    let height = |position: Vector3<f64>, axis: &Vector3<f64>| position.dot(axis) / stature_m(first);
    let pelvis = first[Smpl::Pelvis as usize].position;
    let [low, high] = LIES;
    height(pelvis, axis) > low
        && sampled(frames).flatten().all(|pose| height(pose.position, axis) > -low)
        && (first.iter().all(|pose| height(pose.position, axis) < high)
            || height(pelvis - above_ankles(first, Smpl::Pelvis), turned).abs() > ANKLES)
}

/// Returns a rotation (determinant +1) that takes `up` to z. For +Y it is the usual one: +Z forward to x and +X
/// to y (left).
fn canonical_from_file(up: Vector3<f64>) -> Matrix3<f64> {
    let left = if up.x == 0.0 { Vector3::x() } else { Vector3::y() };
    let front = left.cross(&up);
    Matrix3::from_rows(&[front.transpose(), left.transpose(), up.transpose()])
}

/// Returns the vector to add to every position: the root's OFFSET or zero. Exporters disagree on whether the
/// root's position channels replace its OFFSET or add to it. In the right case the person stands on the floor.
fn guess_shift(frames: &[RigFrame], canonical: &Matrix3<f64>, offset: Vector3<f64>) -> Vector3<f64> {
    let lowest = |frame: &RigFrame| frame.iter().map(|pose| (canonical * pose.position).z).fold(f64::MAX, f64::min);
    let floor = frames.iter().map(lowest).fold(f64::MAX, f64::min);
    let raised = floor + (canonical * offset).z;
    if raised.abs() < floor.abs() { offset } else { Vector3::zeros() }
}

/// Returns the quarter turn about z after which the first frame of motion faces +x best. Z-up exporters have no
/// common forward axis.
fn face_forward(frames: &[RigFrame], canonical: &Matrix3<f64>) -> Matrix3<f64> {
    let Some(frame) = frames.get(1).or(frames.first()) else {
        return Matrix3::identity();
    };
    let at = |joint: Smpl| canonical * frame[joint as usize].position;
    let left = at(Smpl::LeftHip) - at(Smpl::RightHip);
    let quarters = (left.x.atan2(left.y) / std::f64::consts::FRAC_PI_2).round();
    *Rotation3::from_axis_angle(&Vector3::z_axis(), quarters * std::f64::consts::FRAC_PI_2).matrix()
}
