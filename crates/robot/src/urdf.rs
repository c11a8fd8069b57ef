//! Parses URDF text into a checked tree of links and joints.

use crate::error::RobotError;
use crate::inertia::Inertia;
use crate::pose::Pose;
use crate::read::Urdf;
use crate::visual::{MeshVisual, Visual};
use nalgebra::Vector3;
use std::collections::HashMap;
use urdf_rs::JointType;

/// Largest number of links. A dual-arm robot with two five-fingered hands has 93.
pub(crate) const LINKS_MAX: usize = 512;
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
    /// The joint that this one follows.
    pub(crate) mimics: Option<Mimic>,
    /// Its line in the text.
    pub(crate) line: usize,
}

/// A joint stands at multiplier x its leader's position + offset.
#[derive(Clone, Debug)]
pub(crate) struct Mimic {
    pub(crate) leader: String,
    pub(crate) multiplier: f64,
    pub(crate) offset: f64,
}

impl UrdfJoint {
    /// Its mechanical stops, rad or m. A joint without end has none, and neither has one whose range is a placeholder.
    pub(crate) fn stops(&self) -> [f64; 2] {
        let limited = matches!(self.kind, JointType::Revolute | JointType::Prismatic);
        let placeholder = self.limit.lower > self.limit.upper;
        if limited && !placeholder { [self.limit.lower, self.limit.upper] } else { [f64::MIN, f64::MAX] }
    }

    /// The position to which its leader moves it, within its stops. None without a leader whose position is known.
    pub(crate) fn follows(&self, position: impl Fn(&str) -> Option<f64>) -> Option<f64> {
        let mimic = self.mimics.as_ref()?;
        let [lower, upper] = self.stops();
        Some((mimic.multiplier * position(&mimic.leader)? + mimic.offset).max(lower).min(upper))
    }
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
        let Urdf { robot, link_lines, joint_lines } = Urdf::read(file, text)?;
        if robot.links.len() > LINKS_MAX {
            let (key, count) = ("links".into(), robot.links.len());
            return Err(RobotError::TooMany { file: file.into(), key, count, bound: LINKS_MAX });
        }
        let links: Vec<String> = robot.links.iter().map(|link| link.name.clone()).collect();
        let index = unique(file, "link", &links)?;
        let names: Vec<String> = robot.joints.iter().map(|joint| joint.name.clone()).collect();
        unique(file, "joint", &names)?;
        let place = |line: usize| format!("{file}: line {line}");
        let mut errors = Vec::new();
        let joints = robot.joints.iter().zip(joint_lines);
        let joints = joints
            .filter_map(|(joint, line)| RobotError::keep(read_joint(&place(line), joint, &index, line), &mut errors));
        let joints: Vec<UrdfJoint> = joints.collect();
        let inertias = robot.links.iter().zip(link_lines);
        let inertias =
            inertias.filter_map(|(link, line)| RobotError::keep(crate::inertia::read(&place(line), link), &mut errors));
        let inertias = inertias.collect();
        RobotError::all(errors)?;
        let (joint_above, root) = check_tree(file, &links, &joints)?;
        let visuals = robot.links.iter().map(|link| crate::visual::read(&link.visual)).collect();
        let meshes = robot.links.iter().map(|link| crate::visual::read_meshes(link, &robot.materials)).collect();
        Ok(Self { name: robot.name, links, visuals, meshes, inertias, joints, joint_above, root })
    }

    pub(crate) fn joint(&self, name: &str) -> Option<usize> {
        self.joints.iter().position(|joint| joint.name == name)
    }

    pub(crate) fn link(&self, name: &str) -> Option<usize> {
        self.links.iter().position(|link| link == name)
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

fn read_joint(
    file: &str,
    joint: &urdf_rs::Joint,
    links: &HashMap<&str, usize>,
    line: usize,
) -> Result<UrdfJoint, RobotError> {
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
    // A direction has no length. Only zero is none.
    if joint.joint_type != JointType::Fixed && !(axis.norm() > 0.0 && axis.norm() < f64::INFINITY) {
        return Err(refuse("length of axis", axis.norm(), "must be above 0"));
    }
    Ok(UrdfJoint {
        name: joint.name.clone(),
        kind: joint.joint_type.clone(),
        parent: link("parent", &joint.parent.link)?,
        child: link("child", &joint.child.link)?,
        parent_from_joint: Pose::from_xyz_rpy(xyz, rpy),
        axis: if joint.joint_type == JointType::Fixed { Vector3::zeros() } else { axis.normalize() },
        limit: joint.limit.clone(),
        mimics: joint.mimic.as_ref().map(|mimic| Mimic {
            leader: mimic.joint.clone(),
            multiplier: mimic.multiplier.unwrap_or(1.0),
            offset: mimic.offset.unwrap_or(0.0),
        }),
        line,
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
