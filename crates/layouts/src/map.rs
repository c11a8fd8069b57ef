//! Source of each joint of SMPL-22, and the set of all known layouts.

use crate::axes::Axes;
use crate::error::LayoutError;
use crate::lifter::{ImagePoints, POINTS, Point};
use messages::{RAW_JOINTS_MAX, RawSkeleton, SMPL_JOINTS, SMPL_PARENT, Smpl, raw_flag};
use serde::Deserialize;

/// Data that a layout sends, besides confidences.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Eq)]
#[serde(rename_all = "kebab-case")]
pub enum Sends {
    /// Positions.
    Positions,
    /// Positions, with or without global rotations.
    GlobalRotations,
    /// Local rotations, and the position of the root.
    LocalRotations,
    /// Any of the three. The flags of the frame decide.
    #[serde(skip)]
    Any,
}

/// No joint of the client.
pub(crate) const NONE: u8 = u8::MAX;

/// Conversion of one layout to SMPL-22.
#[derive(Clone, Debug, PartialEq)]
pub struct Map {
    pub(crate) number: u32,
    pub(crate) name: String,
    /// Number of joints in a frame.
    pub(crate) joints: usize,
    pub(crate) axes: Axes,
    pub(crate) unit_m: f64,
    /// True if quaternions are w x y z.
    pub(crate) w_first: bool,
    pub(crate) sends: Sends,
    /// True if a camera sees the person. Then the image may be mirrored.
    pub(crate) camera: bool,
    /// Confidence that counts as 1.
    pub(crate) confidence_max: f64,
    /// For each joint of SMPL-22: the client's joint, or two whose middle it is, or `NONE`.
    pub(crate) from: [[u8; 2]; SMPL_JOINTS],
    /// The client's joint that is each point of an image, or `NONE`.
    pub(crate) image: [u8; POINTS],
    /// Parent of each of the client's joints. `NONE` for the root and for unused joints.
    pub(crate) parent: [u8; RAW_JOINTS_MAX],
    /// The client's joints whose local rotations are needed, parents before children.
    pub(crate) order: [u8; RAW_JOINTS_MAX],
    pub(crate) ordered: usize,
}

/// Joints that every layout must have, because the arms are retargeted.
const ARMS: [Smpl; 6] =
    [Smpl::LeftShoulder, Smpl::RightShoulder, Smpl::LeftElbow, Smpl::RightElbow, Smpl::LeftWrist, Smpl::RightWrist];

/// Points that a layout without positions must have.
const IMAGE: [Point; 8] = [
    Point::LeftShoulder,
    Point::RightShoulder,
    Point::LeftElbow,
    Point::RightElbow,
    Point::LeftWrist,
    Point::RightWrist,
    Point::LeftHip,
    Point::RightHip,
];

impl Map {
    /// Number by which a frame names the layout.
    pub fn number(&self) -> u32 {
        self.number
    }

    /// Name in reports.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Returns true if a camera sees the person. Such layouts are noisy.
    pub fn camera(&self) -> bool {
        self.camera
    }

    /// Returns true if joints come from the points of an image alone. Such a layout needs a [`Lifter`](crate::Lifter).
    pub fn is_flat(&self) -> bool {
        self.camera && !ARMS.into_iter().any(|joint| self.has(joint as usize))
    }

    /// Returns the points of an image that the frame has, with the person's own left and right. `None` if the layout has none.
    pub fn image(&self, raw: &RawSkeleton) -> Option<ImagePoints> {
        if self.image.iter().all(|&joint| joint == NONE) || raw.joint_count as usize != self.joints {
            return None;
        }
        let mut image = ImagePoints::NONE;
        for (point, &joint) in self.image.iter().enumerate().filter(|&(_, &joint)| joint != NONE) {
            let [x, y, _] = raw.positions[usize::from(joint)];
            if x.is_finite() && y.is_finite() {
                image.points[point] = [x, y];
                image.seen[point] = raw.confidence[usize::from(joint)] / self.confidence_max as f32;
            }
        }
        Some(if raw.flags & raw_flag::MIRRORED == 0 { image } else { image.mirrored() })
    }

    pub(crate) fn has(&self, joint: usize) -> bool {
        self.from[joint][0] != NONE
    }

    /// Returns a joint of SMPL-22 that is missing and cannot be derived.
    pub(crate) fn missing(&self) -> Option<usize> {
        let points = IMAGE.map(|point| self.image[point as usize]);
        if self.is_flat() && points.iter().all(|&joint| joint != NONE) {
            return None;
        }
        let arm = ARMS.into_iter().map(|joint| joint as usize).find(|&joint| !self.has(joint));
        let pelvis = self.has(Smpl::Pelvis as usize);
        let hips = [Smpl::LeftHip as usize, Smpl::RightHip as usize].into_iter().find(|&joint| !self.has(joint));
        let trunk = match self.sends {
            Sends::LocalRotations => (!pelvis).then_some(Smpl::Pelvis as usize),
            _ => hips.filter(|_| !pelvis),
        };
        arm.or(trunk)
    }

    /// Orders the joints whose rotations are needed by their parents. Returns the joint at which the parents form
    /// a cycle as an error.
    pub(crate) fn arrange(&mut self) -> Result<(), usize> {
        let mut placed = [false; RAW_JOINTS_MAX];
        self.ordered = 0;
        for [joint, _] in self.from.into_iter().filter(|&[joint, _]| joint != NONE) {
            // From the joint to the first ordered ancestor, and back.
            let mut path = [NONE; RAW_JOINTS_MAX];
            let (mut length, mut at) = (0, joint);
            while at != NONE && !placed[usize::from(at)] {
                if length == RAW_JOINTS_MAX || path[..length].contains(&at) {
                    return Err(usize::from(joint));
                }
                path[length] = at;
                length += 1;
                at = self.parent[usize::from(at)];
            }
            for &joint in path[..length].iter().rev() {
                placed[usize::from(joint)] = true;
                self.order[self.ordered] = joint;
                self.ordered += 1;
            }
        }
        Ok(())
    }

    /// Takes the parents of SMPL-22. Each joint must come from one of the client's.
    pub(crate) fn hang_like_smpl(&mut self) {
        for (joint, parent) in SMPL_PARENT.into_iter().enumerate().skip(1) {
            let (own, above) = (self.from[joint][0], self.from[parent][0]);
            if let Some(parent) = self.parent.get_mut(usize::from(own)) {
                *parent = above;
            }
        }
    }
}

/// All known layouts.
#[derive(Clone, Debug, PartialEq)]
pub struct Layouts {
    pub(crate) maps: Vec<Map>,
}

impl Default for Layouts {
    fn default() -> Self {
        Self { maps: crate::builtin::all() }
    }
}

impl Layouts {
    /// Adds `map` to the layouts. Its number must be unused.
    ///
    /// # Errors
    /// Returns [`LayoutError::Value`] with `file` if the number is used.
    pub fn add(&mut self, file: &str, map: Map) -> Result<(), LayoutError> {
        if let Some(other) = self.find(map.number) {
            let bound = format!("unique: {} has it already", other.name);
            let (file, key, value) = (file.to_owned(), "number".to_owned(), map.number.to_string());
            return Err(LayoutError::Value { file, key, value, bound });
        }
        self.maps.push(map);
        Ok(())
    }

    /// Returns the layout with this number.
    pub fn find(&self, number: u32) -> Option<&Map> {
        self.maps.iter().find(|map| map.number == number)
    }

    /// Iterates over all layouts.
    pub fn iter(&self) -> impl Iterator<Item = &Map> {
        self.maps.iter()
    }
}
