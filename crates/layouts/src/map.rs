//! Where each joint of SMPL-22 comes from, and the set of all layouts that are understood.

use crate::axes::Axes;
use crate::error::LayoutError;
use messages::{RAW_JOINTS_MAX, SMPL_JOINTS, SMPL_PARENT, Smpl};
use serde::Deserialize;

/// What a layout sends beside confidences.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Eq)]
#[serde(rename_all = "kebab-case")]
pub enum Sends {
    /// Positions.
    Positions,
    /// Positions, with global rotations or without.
    GlobalRotations,
    /// Local rotations, and the position of the root.
    LocalRotations,
    /// Any of the three, as the flags of the frame say.
    #[serde(skip)]
    Any,
}

/// No joint of the client's.
pub(crate) const NONE: u8 = u8::MAX;

/// How one layout becomes SMPL-22.
#[derive(Clone, Debug, PartialEq)]
pub struct Map {
    pub(crate) number: u32,
    pub(crate) name: String,
    /// Joints of a frame.
    pub(crate) joints: usize,
    pub(crate) axes: Axes,
    pub(crate) unit_m: f64,
    /// Quaternions are w x y z.
    pub(crate) w_first: bool,
    pub(crate) sends: Sends,
    /// Seen by a camera: the image may be mirrored.
    pub(crate) camera: bool,
    /// The confidence that counts as 1.
    pub(crate) confidence_max: f64,
    /// For each joint of SMPL-22 the client's joint, or two of them whose middle it is, or `NONE`.
    pub(crate) from: [[u8; 2]; SMPL_JOINTS],
    /// For each of the client's joints its parent; the root and what nobody needs has none.
    pub(crate) parent: [u8; RAW_JOINTS_MAX],
    /// The client's joints whose local rotations are needed, parents before children.
    pub(crate) order: [u8; RAW_JOINTS_MAX],
    pub(crate) ordered: usize,
}

/// Joints that no layout can do without: the arms are what is retargeted.
const ARMS: [Smpl; 6] =
    [Smpl::LeftShoulder, Smpl::RightShoulder, Smpl::LeftElbow, Smpl::RightElbow, Smpl::LeftWrist, Smpl::RightWrist];

impl Map {
    /// The number by which a frame names it.
    pub fn number(&self) -> u32 {
        self.number
    }

    /// Its name in reports.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Whether a camera sees the person: such layouts tremble.
    pub fn camera(&self) -> bool {
        self.camera
    }

    pub(crate) fn has(&self, joint: usize) -> bool {
        self.from[joint][0] != NONE
    }

    /// The joint of SMPL-22 that is missing though nothing can stand for it.
    pub(crate) fn missing(&self) -> Option<usize> {
        let arm = ARMS.into_iter().map(|joint| joint as usize).find(|&joint| !self.has(joint));
        let pelvis = self.has(Smpl::Pelvis as usize);
        let hips = [Smpl::LeftHip as usize, Smpl::RightHip as usize].into_iter().find(|&joint| !self.has(joint));
        let trunk = match self.sends {
            Sends::LocalRotations => (!pelvis).then_some(Smpl::Pelvis as usize),
            _ => hips.filter(|_| !pelvis),
        };
        arm.or(trunk)
    }

    /// Puts the joints whose rotations are needed in order, from the parents that are set. The joint at which they run in a
    /// circle, if they do.
    pub(crate) fn arrange(&mut self) -> Result<(), usize> {
        let mut placed = [false; RAW_JOINTS_MAX];
        self.ordered = 0;
        for [joint, _] in self.from.into_iter().filter(|&[joint, _]| joint != NONE) {
            // From the joint to the first ancestor that has its place, and back.
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

    /// Parents as those of SMPL-22, where each joint comes from one of the client's.
    pub(crate) fn hang_like_smpl(&mut self) {
        for (joint, parent) in SMPL_PARENT.into_iter().enumerate().skip(1) {
            let (own, above) = (self.from[joint][0], self.from[parent][0]);
            if let Some(parent) = self.parent.get_mut(usize::from(own)) {
                *parent = above;
            }
        }
    }
}

/// Every layout that is understood.
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
    /// The built-in layouts and `map`; its number must be its own.
    ///
    /// # Errors
    /// [`LayoutError::Value`], naming `file`.
    pub fn add(&mut self, file: &str, map: Map) -> Result<(), LayoutError> {
        if let Some(other) = self.find(map.number) {
            let bound = format!("a number of its own: {} has it", other.name);
            let (file, key, value) = (file.to_owned(), "number".to_owned(), map.number.to_string());
            return Err(LayoutError::Value { file, key, value, bound });
        }
        self.maps.push(map);
        Ok(())
    }

    /// The layout of this number.
    pub fn find(&self, number: u32) -> Option<&Map> {
        self.maps.iter().find(|map| map.number == number)
    }

    /// All of them.
    pub fn iter(&self) -> impl Iterator<Item = &Map> {
        self.maps.iter()
    }
}
