//! Converts one frame of any layout to SMPL-22.

use crate::closure::closure;
use crate::map::{Layouts, Map, NONE, Sends};
use crate::neutral::{COLLAR, HIPS_PER_SHOULDERS, OFFSET_M, UP_THE_TRUNK};
use crate::unseen;
use messages::{
    HingeCalibration, Layout, RAW_JOINTS_MAX, RawSkeleton, SMPL_JOINTS, SMPL_OTHER_SIDE, SMPL_PARENT, SkeletonLayout,
    Smpl, raw_flag, with_closure,
};
use nalgebra::{Quaternion, Vector3};

/// Reason for which a frame cannot be converted. This crate does not judge whether its numbers are plausible.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Refusal {
    /// No layout has this number.
    Layout,
    /// The number of joints is not the layout's, or the layout does not allow the flags.
    Count,
}

/// Largest error of a local rotation's norm, as `skeleton` allows it for global ones. A larger one becomes zero,
/// and so does every rotation below it in the tree. `skeleton` refuses both because they have no unit norm.
const NORM_ERROR_MAX: f64 = 1e-3;

/// The person during the conversion: in our axes, m. Quaternions are x y z w in their own fields.
struct Body {
    position: [Vector3<f64>; SMPL_JOINTS],
    rotation: [Quaternion<f64>; SMPL_JOINTS],
    confidence: [f64; SMPL_JOINTS],
}

impl Layouts {
    /// Converts the frame to SMPL-22 in our axes. Header, session, person and all data outside the layout stay
    /// unchanged. A joint that is marked as not seen, by NaN or zeros, loses its confidence. A frame of SMPL-22 with positions
    /// or global rotations is otherwise returned unchanged.
    ///
    /// ```
    /// use layouts::{Layouts, Refusal};
    /// use messages::{Layout, RawSkeleton, SkeletonLayout};
    ///
    /// let camera = SkeletonLayout::MediaPipe33 as u32;
    /// let mut raw = RawSkeleton { layout: camera, joint_count: 33, ..RawSkeleton::ZERO };
    /// let converted = Layouts::default().convert(&raw).unwrap();
    /// assert_eq!((converted.layout, converted.joint_count), (SkeletonLayout::Smpl22 as u32, 22));
    ///
    /// raw.joint_count = 32;
    /// assert_eq!(Layouts::default().convert(&raw).unwrap_err(), Refusal::Count);
    /// ```
    ///
    /// # Errors
    /// Returns [`Refusal`] if the layout is unknown, or if the frame does not match its layout.
    pub fn convert(&self, raw: &RawSkeleton) -> Result<RawSkeleton, Refusal> {
        let map = self.find(raw.layout).ok_or(Refusal::Layout)?;
        let mut settled = *raw;
        unseen::settle(map, &mut settled);
        if raw.layout == SkeletonLayout::Smpl22 as u32 && raw.flags & raw_flag::LOCAL == 0 {
            return Ok(settled);
        }
        convert(map, &settled)
    }
}

/// See [`Layouts::convert`]. `map` must be that of the frame's layout.
fn convert(map: &Map, raw: &RawSkeleton) -> Result<RawSkeleton, Refusal> {
    let known = raw_flag::MIRRORED | raw_flag::ROTATIONS | raw_flag::LOCAL | raw_flag::CLUTCH | raw_flag::CLOSURE;
    if raw.joint_count as usize != map.joints || raw.flags & !known != 0 {
        return Err(Refusal::Count);
    }
    let sent = match (raw.flags & raw_flag::ROTATIONS != 0, raw.flags & raw_flag::LOCAL != 0) {
        (false, false) => Sends::Positions,
        (true, false) => Sends::GlobalRotations,
        (true, true) => Sends::LocalRotations,
        (false, true) => return Err(Refusal::Count),
    };
    let allowed = match map.sends {
        Sends::Any => true,
        Sends::GlobalRotations => sent != Sends::LocalRotations,
        only => sent == only,
    };
    if !allowed {
        return Err(Refusal::Count);
    }
    let mirrored = raw.flags & raw_flag::MIRRORED != 0;
    // A frame that cannot be mirrored back stays mirrored, and is refused for it.
    let turned_back = mirrored && map.camera && sent == Sends::Positions;
    let body = match sent {
        Sends::LocalRotations => from_local(map, raw),
        sent => from_global(map, raw, sent == Sends::GlobalRotations, turned_back),
    };
    let mut out = RawSkeleton::ZERO;
    out.header = raw.header;
    out.session_nonce = raw.session_nonce;
    out.operator_id = raw.operator_id;
    out.layout = SkeletonLayout::Smpl22 as u32;
    out.joint_count = SMPL_JOINTS as u32;
    out.flags = if sent == Sends::Positions { 0 } else { raw_flag::ROTATIONS };
    out.flags |= if mirrored && !turned_back { raw_flag::MIRRORED } else { 0 };
    out.flags |= raw.flags & raw_flag::CLUTCH;
    let [left, right] = closure(raw);
    out.flags = with_closure(out.flags, if turned_back { [right, left] } else { [left, right] });
    out.calibration = calibration(map, &raw.calibration);
    for joint in 0..SMPL_JOINTS {
        let q = body.rotation[joint];
        out.positions[joint] = [0, 1, 2].map(|axis| body.position[joint][axis] as f32);
        out.rotations[joint] = [q.i, q.j, q.k, q.w].map(|value| value as f32);
        out.confidence[joint] = body.confidence[joint] as f32;
    }
    Ok(out)
}

/// Returns the smaller one, and NaN if either is NaN.
fn lower(a: f64, b: f64) -> f64 {
    if a.is_nan() || b.is_nan() { f64::NAN } else { a.min(b) }
}

fn position(map: &Map, raw: &RawSkeleton, joint: u8) -> Vector3<f64> {
    let theirs = raw.positions[usize::from(joint)].map(|value| f64::from(value) * map.unit_m);
    Vector3::from(map.axes.polar(theirs))
}

fn rotation(map: &Map, raw: &RawSkeleton, joint: u8) -> Quaternion<f64> {
    let [a, b, c, d] = raw.rotations[usize::from(joint)].map(f64::from);
    let (vector, w) = if map.w_first { ([b, c, d], a) } else { ([a, b, c], d) };
    let [i, j, k] = map.axes.axial(vector);
    Quaternion::new(w, i, j, k)
}

fn confidence(map: &Map, raw: &RawSkeleton, joint: u8) -> f64 {
    f64::from(raw.confidence[usize::from(joint)]) / map.confidence_max
}

/// Converts the hinges, which are axes of rotation.
fn calibration(map: &Map, theirs: &HingeCalibration) -> HingeCalibration {
    let hinge = theirs.hinge.map(|axis| map.axes.axial(axis.map(f64::from)).map(|value| value as f32));
    HingeCalibration { hinge, ..*theirs }
}

impl Body {
    const NOBODY: Self = Self {
        position: [Vector3::new(0.0, 0.0, 0.0); SMPL_JOINTS],
        rotation: [Quaternion::new(1.0, 0.0, 0.0, 0.0); SMPL_JOINTS],
        confidence: [0.0; SMPL_JOINTS],
    };

    fn middle(&self, a: Smpl, b: Smpl) -> (Vector3<f64>, f64) {
        let (a, b) = (a as usize, b as usize);
        ((self.position[a] + self.position[b]) / 2.0, lower(self.confidence[a], self.confidence[b]))
    }

    fn set(&mut self, joint: usize, position: Vector3<f64>, confidence: f64) {
        (self.position[joint], self.confidence[joint]) = (position, confidence);
    }

    /// Derives the joints of the trunk that the layout does not send.
    fn derive(&mut self, map: &Map) {
        let (shoulders, seen) = self.middle(Smpl::LeftShoulder, Smpl::RightShoulder);
        for (hip, shoulder) in [(Smpl::LeftHip, Smpl::LeftShoulder), (Smpl::RightHip, Smpl::RightShoulder)] {
            if !map.has(hip as usize) {
                let aside = (self.position[shoulder as usize] - shoulders) * HIPS_PER_SHOULDERS;
                let seen = lower(seen, self.confidence[Smpl::Pelvis as usize]);
                self.set(hip as usize, self.position[Smpl::Pelvis as usize] + aside, seen);
            }
        }
        let (hips, hips_seen) = self.middle(Smpl::LeftHip, Smpl::RightHip);
        for (joint, share) in UP_THE_TRUNK {
            if !map.has(joint) {
                self.set(joint, hips + (shoulders - hips) * share, lower(seen, hips_seen));
            }
        }
        for (collar, shoulder) in [(Smpl::LeftCollar, Smpl::LeftShoulder), (Smpl::RightCollar, Smpl::RightShoulder)] {
            if !map.has(collar as usize) {
                let aside = (self.position[shoulder as usize] - shoulders) * COLLAR;
                self.set(collar as usize, shoulders + aside, seen);
            }
        }
    }
}

/// Builds the body from positions, and from global rotations if there are any. A mirror image is turned back: y
/// changes its sign, and the sides change their names.
fn from_global(map: &Map, raw: &RawSkeleton, has_rotations: bool, mirrored: bool) -> Body {
    let mut body = Body::NOBODY;
    for joint in 0..SMPL_JOINTS {
        let [a, b] = map.from[if mirrored { SMPL_OTHER_SIDE[joint] } else { joint }];
        if has_rotations {
            // A joint without a rotation takes its parent's.
            body.rotation[joint] = if a == NONE { body.rotation[SMPL_PARENT[joint]] } else { rotation(map, raw, a) };
        }
        if a == NONE {
            continue;
        }
        let mut place =
            if a == b { position(map, raw, a) } else { (position(map, raw, a) + position(map, raw, b)) / 2.0 };
        if mirrored {
            place.y = -place.y;
        }
        body.set(joint, place, lower(confidence(map, raw, a), confidence(map, raw, b)));
    }
    body.derive(map);
    body
}

/// Normalises the rotation. Returns zero if its norm is off by more than the bound, and NaN if the norm is NaN.
fn unit(q: Quaternion<f64>) -> Quaternion<f64> {
    let norm = q.norm();
    if (norm - 1.0).abs() > NORM_ERROR_MAX { q * 0.0 } else { q / norm }
}

/// q v q*, for a unit q.
fn rotate(q: Quaternion<f64>, v: Vector3<f64>) -> Vector3<f64> {
    let axis = q.vector();
    let twice = axis.cross(&v) * 2.0;
    v + twice * q.w + axis.cross(&twice)
}

/// Builds the body from local rotations: along the client's tree to global ones, and over the neutral skeleton to
/// positions. A joint has the lowest confidence of itself and its ancestors.
fn from_local(map: &Map, raw: &RawSkeleton) -> Body {
    let mut global = [(Quaternion::new(1.0, 0.0, 0.0, 0.0), 1.0); RAW_JOINTS_MAX];
    for &joint in &map.order[..map.ordered] {
        let (own, seen) = (unit(rotation(map, raw, joint)), confidence(map, raw, joint));
        let parent = map.parent[usize::from(joint)];
        global[usize::from(joint)] = match parent {
            NONE => (own, seen),
            parent => {
                let (above, above_seen) = global[usize::from(parent)];
                (above * own, lower(above_seen, seen))
            }
        };
    }
    let mut body = Body::NOBODY;
    for joint in 0..SMPL_JOINTS {
        let (parent, own) = (SMPL_PARENT[joint], map.from[joint][0]);
        let (rotation, seen) = match own {
            NONE => (body.rotation[parent], body.confidence[parent]),
            own => global[usize::from(own)],
        };
        let place = match joint {
            0 => position(map, raw, own.min(RAW_JOINTS_MAX as u8 - 1)),
            _ => body.position[parent] + rotate(body.rotation[parent], Vector3::from(OFFSET_M.map(|axis| axis[joint]))),
        };
        body.rotation[joint] = rotation;
        body.set(joint, place, seen);
    }
    body
}
