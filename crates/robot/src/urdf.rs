//! Parses URDF text into a checked tree of links and joints.

use crate::error::RobotError;
use crate::inertia::Inertia;
use crate::pose::Pose;
use crate::visual::{MeshVisual, Visual};
use nalgebra::Vector3;
use quick_xml::Reader;
use quick_xml::events::Event;
use std::collections::HashMap;
use urdf_rs::JointType;

/// Longest accepted text, bytes. A dual-arm robot with two hands has 0.2 MB.
pub(crate) const TEXT_BYTES_MAX: usize = 5 << 20;
/// Largest number of links. A dual-arm robot with two five-fingered hands has 93.
pub(crate) const LINKS_MAX: usize = 512;
/// Deepest nesting, because the parser recurses. robot/link/visual/material/color and extensions of
/// simulators stay below 12.
const DEPTH_MAX: usize = 24;
/// Largest difference of a joint's axis from unit length. It allows for the rounding of its text.
const AXIS_LENGTH_TOLERANCE: f64 = 1e-6;

pub(crate) struct UrdfJoint {
    pub(crate) name: String,
    pub(crate) kind: JointType,
    pub(crate) parent: usize,
    pub(crate) child: usize,
    /// The joint's frame in the parent link's frame.
    pub(crate) parent_from_joint: Pose,
    /// Unit axis in the joint's frame. It has no meaning for a fixed joint.
    pub(crate) axis: Vector3<f64>,
    /// Limits as written. They are checked if the joint is commanded.
    pub(crate) limit: urdf_rs::JointLimit,
    /// Name of the joint that this one follows.
    pub(crate) mimics: Option<String>,
}

pub(crate) struct Tree {
    pub(crate) name: String,
    pub(crate) links: Vec<String>,
    /// The shapes to draw of each link, in its own frame.
    pub(crate) visuals: Vec<Vec<Visual>>,
    pub(crate) meshes: Vec<Vec<MeshVisual>>,
    /// Mass properties of each link, in its own frame.
    pub(crate) inertias: Vec<Inertia>,
    pub(crate) joints: Vec<UrdfJoint>,
    /// The joint above each link. None above the root.
    pub(crate) joint_above: Vec<Option<usize>>,
    pub(crate) root: usize,
}

impl Tree {
    pub(crate) fn parse(file: &str, text: &str) -> Result<Self, RobotError> {
        check_text(file, text)?;
        let robot = urdf_rs::read_from_string(text)
            .map_err(|error| RobotError::Syntax { file: file.into(), cause: error.to_string() })?;
        if robot.links.len() > LINKS_MAX {
            let (key, count) = ("links".into(), robot.links.len());
            return Err(RobotError::TooMany { file: file.into(), key, count, bound: LINKS_MAX });
        }
        let links: Vec<String> = robot.links.iter().map(|link| link.name.clone()).collect();
        let index = unique(file, "link", &links)?;
        let names: Vec<String> = robot.joints.iter().map(|joint| joint.name.clone()).collect();
        let joint_index = unique(file, "joint", &names)?;
        let mut joints = Vec::with_capacity(robot.joints.len());
        for joint in &robot.joints {
            if let Some(mimic) = &joint.mimic
                && !joint_index.contains_key(mimic.joint.as_str())
            {
                let key = format!("joint `{}`: mimic", joint.name);
                return Err(RobotError::unknown(file, key, &mimic.joint, "a joint of this file"));
            }
            joints.push(read_joint(file, joint, &index)?);
        }
        let (joint_above, root) = check_tree(file, &links, &joints)?;
        let visuals = robot.links.iter().map(|link| crate::visual::read(&link.visual)).collect();
        let meshes = robot.links.iter().map(|link| crate::visual::read_meshes(link, &robot.materials)).collect();
        let inertias = robot.links.iter().map(|link| crate::inertia::read(file, link)).collect::<Result<_, _>>()?;
        Ok(Self { name: robot.name, links, visuals, meshes, inertias, joints, joint_above, root })
    }

    pub(crate) fn joint(&self, name: &str) -> Option<usize> {
        self.joints.iter().position(|joint| joint.name == name)
    }

    pub(crate) fn link(&self, name: &str) -> Option<usize> {
        self.links.iter().position(|link| link == name)
    }
}

/// Refuses texts that the next parsers must never see: huge or deep texts, document types, entities.
fn check_text(file: &str, text: &str) -> Result<(), RobotError> {
    if text.len() > TEXT_BYTES_MAX {
        return Err(RobotError::TooLong { file: file.into(), bytes: text.len(), bound: TEXT_BYTES_MAX });
    }
    let syntax = |cause: String| RobotError::Syntax { file: file.into(), cause };
    let mut reader = Reader::from_str(text);
    let mut depth = 0_usize;
    loop {
        match reader.read_event() {
            Err(error) => return Err(syntax(format!("byte {}: {error}", reader.error_position()))),
            Ok(Event::DocType(_)) => {
                return Err(RobotError::Forbidden { file: file.into(), construct: "a document type (DTD)".into() });
            }
            Ok(Event::GeneralRef(_)) => {
                return Err(RobotError::Forbidden { file: file.into(), construct: "an entity reference".into() });
            }
            Ok(Event::Start(_)) => {
                depth += 1;
                if depth > DEPTH_MAX {
                    let key = "depth of nested elements".into();
                    return Err(RobotError::TooMany { file: file.into(), key, count: depth, bound: DEPTH_MAX });
                }
            }
            Ok(Event::End(_)) => depth = depth.saturating_sub(1),
            Ok(Event::Eof) if depth > 0 => return Err(syntax("ends inside an element".into())),
            Ok(Event::Eof) => return Ok(()),
            Ok(Event::Empty(_) | Event::Text(_) | Event::CData(_) | Event::Comment(_)) => {}
            Ok(Event::Decl(_) | Event::PI(_)) => {}
        }
    }
}

fn unique<'a>(file: &str, key: &str, names: &'a [String]) -> Result<HashMap<&'a str, usize>, RobotError> {
    let mut index = HashMap::with_capacity(names.len());
    for (at, name) in names.iter().enumerate() {
        if index.insert(name.as_str(), at).is_some() {
            return Err(RobotError::duplicate(file, key, name));
        }
    }
    Ok(index)
}

fn read_joint(file: &str, joint: &urdf_rs::Joint, links: &HashMap<&str, usize>) -> Result<UrdfJoint, RobotError> {
    let link = |key: &str, name: &str| {
        let key = format!("joint `{}`: {key}", joint.name);
        links.get(name).copied().ok_or_else(|| RobotError::unknown(file, key, name, "a link of this file"))
    };
    if matches!(joint.joint_type, JointType::Floating | JointType::Planar | JointType::Spherical) {
        let (file, joint, value) = (file.into(), joint.name.clone(), kind_name(&joint.joint_type));
        let bound = "a joint must have at most one axis: make it fixed where it stands, or split it".into();
        return Err(RobotError::JointKind { file, joint, value, bound });
    }
    let refuse = |key: &str, value: f64, bound: &str| RobotError::Joint {
        file: file.into(),
        joint: joint.name.clone(),
        key: key.into(),
        value,
        bound: bound.into(),
    };
    // No part of one robot reaches farther than 100 m or turns more than 100 times.
    let checked = |key: &str, values: [f64; 3], most: f64| {
        let wrong = values.into_iter().find(|value| !(value.abs() <= most));
        wrong.map_or(Ok(values), |value| Err(refuse(key, value, &format!("at most {most} in magnitude"))))
    };
    let xyz = checked("origin xyz", *joint.origin.xyz, 100.0)?;
    let rpy = checked("origin rpy", *joint.origin.rpy, 628.0)?;
    let axis = Vector3::from(*joint.axis.xyz);
    if joint.joint_type != JointType::Fixed && !((axis.norm() - 1.0).abs() <= AXIS_LENGTH_TOLERANCE) {
        return Err(refuse("length of axis", axis.norm(), "must be 1"));
    }
    Ok(UrdfJoint {
        name: joint.name.clone(),
        kind: joint.joint_type.clone(),
        parent: link("parent", &joint.parent.link)?,
        child: link("child", &joint.child.link)?,
        parent_from_joint: Pose::from_xyz_rpy(xyz, rpy),
        axis: if joint.joint_type == JointType::Fixed { Vector3::zeros() } else { axis.normalize() },
        limit: joint.limit.clone(),
        mimics: joint.mimic.as_ref().map(|leader| leader.joint.clone()),
    })
}

pub(crate) fn kind_name(kind: &JointType) -> String {
    format!("{kind:?}").to_lowercase()
}

/// Checks that there is one root, and that every other link is below exactly one joint. No loop may exist
/// outside the tree.
fn check_tree(file: &str, links: &[String], joints: &[UrdfJoint]) -> Result<(Vec<Option<usize>>, usize), RobotError> {
    let mut joint_above = vec![None; links.len()];
    for (at, joint) in joints.iter().enumerate() {
        if joint_above[joint.child].replace(at).is_some() {
            return Err(RobotError::Loop { file: file.into(), link: links[joint.child].clone() });
        }
    }
    let roots: Vec<usize> = (0..links.len()).filter(|link| joint_above[*link].is_none()).collect();
    let &[root] = roots.as_slice() else {
        let roots = roots.into_iter().map(|link| links[link].clone()).collect();
        return Err(RobotError::Roots { file: file.into(), roots });
    };
    for start in 0..links.len() {
        let mut link = start;
        for _ in 0..links.len() {
            match joint_above[link] {
                Some(joint) => link = joints[joint].parent,
                None => break,
            }
        }
        if link != root {
            return Err(RobotError::Loop { file: file.into(), link: links[start].clone() });
        }
    }
    Ok((joint_above, root))
}
