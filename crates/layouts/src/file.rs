//! Reads a layout from a file.

use crate::axes::{Axes, Direction};
use crate::error::LayoutError;
use crate::lifter::{POINTS, Point};
use crate::map::{Map, NONE, Sends};
use messages::{CUSTOM_LAYOUTS, RAW_JOINTS_MAX, SMPL_JOINTS, SMPL_NAMES};
use serde::Deserialize;

/// The only supported format.
const FORMAT: u32 = 1;
/// Longest name, bytes.
const NAME_MAX: usize = 64;
/// Largest value for full confidence. Assumption: per cent and per mille are below it.
const CONFIDENCE_MAX: f64 = 1e6;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    format: u32,
    name: String,
    number: u32,
    joints: u32,
    x: Direction,
    y: Direction,
    z: Direction,
    handedness: Handedness,
    unit: Unit,
    sends: Sends,
    quaternions: Option<Order>,
    confidence_max: f64,
    camera: bool,
    joint: Vec<Joint>,
}

#[derive(Clone, Copy, Deserialize, PartialEq)]
#[serde(rename_all = "kebab-case")]
enum Handedness {
    Right,
    Left,
}

#[derive(Clone, Copy, Deserialize)]
enum Unit {
    #[serde(rename = "m")]
    Metre,
    #[serde(rename = "cm")]
    Centimetre,
    #[serde(rename = "mm")]
    Millimetre,
}

#[derive(Clone, Copy, Deserialize, PartialEq)]
#[serde(rename_all = "kebab-case")]
enum Order {
    Xyzw,
    Wxyz,
}

/// A joint of the client.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Joint {
    name: String,
    index: u32,
    /// The joint of SMPL-22 that it is.
    is: Option<String>,
    /// The joint of SMPL-22 that lies in the middle between this joint and another one.
    half_of: Option<String>,
    /// The point of an image that it is. x and y are then in heights of the image from its middle, y down.
    point: Option<String>,
    /// Name of its parent joint.
    parent: Option<String>,
}

impl Map {
    /// Reads the text of a layout file. Errors name `file`.
    ///
    /// # Errors
    /// Returns a [`LayoutError`] with file, key, value and bound.
    pub fn parse(file: &str, text: &str) -> Result<Self, LayoutError> {
        let read: File = toml::from_str(text)
            .map_err(|error| LayoutError::Syntax { file: file.to_owned(), cause: error.to_string() })?;
        let refuse = |key: &str, value: &dyn ToString, bound: &str| LayoutError::Value {
            file: file.to_owned(),
            key: key.to_owned(),
            value: value.to_string(),
            bound: bound.to_owned(),
        };
        head(&read, &refuse)?;
        let mut map = Self {
            number: read.number,
            name: read.name.clone(),
            joints: read.joints as usize,
            axes: axes(&read, &refuse)?,
            unit_m: match read.unit {
                Unit::Metre => 1.0,
                Unit::Centimetre => 1e-2,
                Unit::Millimetre => 1e-3,
            },
            w_first: read.quaternions == Some(Order::Wxyz),
            sends: read.sends,
            camera: read.camera,
            confidence_max: read.confidence_max,
            from: [[NONE; 2]; SMPL_JOINTS],
            image: [NONE; POINTS],
            parent: [NONE; RAW_JOINTS_MAX],
            order: [0; RAW_JOINTS_MAX],
            ordered: 0,
        };
        joints(&read, &mut map, &refuse)?;
        if let Some(joint) = map.missing() {
            return Err(refuse("joint", &SMPL_NAMES[joint], "among those that some joint `is`"));
        }
        Ok(map)
    }
}

type Refuse<'a> = &'a dyn Fn(&str, &dyn ToString, &str) -> LayoutError;

fn head(read: &File, refuse: Refuse<'_>) -> Result<(), LayoutError> {
    if read.format != FORMAT {
        return Err(refuse("format", &read.format, "1"));
    }
    if read.name.is_empty() || read.name.len() > NAME_MAX {
        return Err(refuse("name", &format!("{:?}", read.name), "of 1 to 64 bytes"));
    }
    if !CUSTOM_LAYOUTS.contains(&read.number) {
        return Err(refuse("number", &read.number, "in [1000, 9999]"));
    }
    if read.joints == 0 || read.joints as usize > RAW_JOINTS_MAX {
        return Err(refuse("joints", &read.joints, "in [1, 96]"));
    }
    // Written so that NaN is refused too.
    if !(read.confidence_max > 0.0 && read.confidence_max <= CONFIDENCE_MAX) {
        return Err(refuse("confidence_max", &read.confidence_max, "above 0 and at most 1e6"));
    }
    if (read.sends == Sends::Positions) == read.quaternions.is_some() {
        let value = if read.quaternions.is_some() { "given" } else { "missing" };
        return Err(refuse("quaternions", &value, "given exactly if rotations are sent"));
    }
    Ok(())
}

fn axes(read: &File, refuse: Refuse<'_>) -> Result<Axes, LayoutError> {
    let directions = [read.x, read.y, read.z];
    let given = format!("{directions:?}").to_lowercase();
    let axes = Axes::new(directions).ok_or_else(|| refuse("x, y, z", &given, "on three different lines"))?;
    let right = axes.determinant() > 0.0;
    if right != (read.handedness == Handedness::Right) {
        let (declared, is) = if right { ("left", "right") } else { ("right", "left") };
        let bound = format!("{is:?}: x, y, z = {given} has determinant {}", axes.determinant());
        return Err(refuse("handedness", &format!("{declared:?}"), &bound));
    }
    Ok(axes)
}

fn joints(read: &File, map: &mut Map, refuse: Refuse<'_>) -> Result<(), LayoutError> {
    if read.joint.len() > RAW_JOINTS_MAX {
        return Err(refuse("joint", &format!("{} rows", read.joint.len()), "at most 96 rows"));
    }
    for (row, joint) in read.joint.iter().enumerate() {
        let key = |field: &str| format!("joint {:?} {field}", joint.name);
        if joint.index >= read.joints {
            return Err(refuse(&key("index"), &joint.index, &format!("below joints = {}", read.joints)));
        }
        let before = &read.joint[..row];
        if before.iter().any(|other| other.index == joint.index || other.name == joint.name) {
            return Err(refuse(&key("index"), &joint.index, "unique: the name or the index occurs twice"));
        }
        place(map, joint, refuse)?;
        let Some(parent) = &joint.parent else { continue };
        let above = read.joint.iter().find(|other| other.name == *parent && other.index < read.joints);
        let above = above.ok_or_else(|| refuse(&key("parent"), &format!("{parent:?}"), "the name of a joint"))?;
        map.parent[joint.index as usize] = above.index as u8;
    }
    for (name, [a, b]) in SMPL_NAMES.iter().zip(map.from) {
        if a != NONE && b == NONE {
            return Err(refuse("half_of", &format!("{name:?}"), "given twice, or be `is`"));
        }
    }
    if read.sends == Sends::LocalRotations {
        map.arrange().map_err(|index| {
            let joint = read.joint.iter().find(|joint| joint.index as usize == index);
            refuse("parent", &joint.map_or("?", |joint| &joint.name), "on a path to a root, without a cycle")
        })?;
    } else if let Some(joint) = read.joint.iter().find(|joint| joint.parent.is_some()) {
        return Err(refuse(&format!("joint {:?} parent", joint.name), &"given", "given with local rotations only"));
    }
    Ok(())
}

/// Records the joint of SMPL-22 that the client's joint is, or is half of.
fn place(map: &mut Map, joint: &Joint, refuse: Refuse<'_>) -> Result<(), LayoutError> {
    if let Some(name) = &joint.point {
        let refuse = |bound: &str| Err(refuse(&format!("joint {:?} point", joint.name), &format!("{name:?}"), bound));
        return match Point::NAMES.iter().position(|known| known == name) {
            None => refuse(&format!("one of {}", Point::NAMES.join(", "))),
            Some(_) if joint.is.is_some() || joint.half_of.is_some() => refuse("given without `is` and `half_of`"),
            Some(_) if !map.camera => refuse("given with camera = true only"),
            Some(point) if map.image[point] != NONE => refuse("a point that no other row names"),
            Some(point) => {
                map.image[point] = joint.index as u8;
                Ok(())
            }
        };
    }
    let (field, name) = match (&joint.is, &joint.half_of) {
        (None, None) => return Ok(()),
        (Some(_), Some(_)) => {
            return Err(refuse(&format!("joint {:?}", joint.name), &"both", "either `is` or `half_of`"));
        }
        (Some(name), None) => ("is", name),
        (None, Some(name)) => ("half_of", name),
    };
    let key = format!("joint {:?} {field}", joint.name);
    let refuse = |bound: &str| Err(refuse(&key, &format!("{name:?}"), bound));
    let Some(smpl) = SMPL_NAMES.iter().position(|known| known == name) else {
        return refuse(&format!("one of {}", SMPL_NAMES.join(", ")));
    };
    if field == "half_of" && map.sends == Sends::LocalRotations {
        return refuse("`is`, because rotations have no midpoint");
    }
    let index = joint.index as u8;
    match (field, map.from[smpl]) {
        ("is", [NONE, NONE]) => map.from[smpl] = [index, index],
        ("half_of", [NONE, NONE]) => map.from[smpl] = [index, NONE],
        ("half_of", [first, NONE]) => map.from[smpl] = [first, index],
        _ => return refuse("a joint that no other row names"),
    }
    Ok(())
}
