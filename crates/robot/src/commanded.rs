//! The commanded joints in the URDF's tree: their order, the joints that are held, and the bodies between them.

use crate::arm::ArmShape;
use crate::error::RobotError;
use crate::file::{ArmEntries, ArmEntry, RobotFile};
use crate::kinematics::JointFrame;
use crate::model::{BodyLink, Source};
use crate::pose::{Pose, rotation};
use crate::urdf::{Mimic, Tree, UrdfJoint};
use messages::{ARM_JOINTS, JOINTS_MAX};
use nalgebra::Vector3;
use std::collections::BTreeMap;
use std::ops::RangeInclusive;
use urdf_rs::JointType;

/// Bounds of the height of the base link above the floor. Legs and pedestals are shorter.
const BASE_HEIGHT_M: RangeInclusive<f64> = 0.0..=3.0;

/// Least number of joints of an arm: two that point the upper arm, the elbow, and one more.
pub(crate) const ARM_JOINTS_MIN: usize = 4;

/// Largest distance of a held follower from where its leader moves it, rad or m. It allows for rounding in the robot file.
const FOLLOWS: f64 = 1e-3;

/// The commanded joints in the order of messages: body joints with parents first, left arm, right arm.
pub(crate) struct CommandedJoints {
    pub(crate) names: Vec<String>,
    /// Index of each in the URDF.
    pub(crate) at: Vec<usize>,
    pub(crate) body_count: usize,
    /// Number of joints of each arm.
    pub(crate) arm_count: usize,
    pub(crate) prismatic: [bool; JOINTS_MAX],
    /// Positions of the movable joints that nothing commands, by their index in the URDF, rad or m.
    held: BTreeMap<usize, f64>,
}

impl CommandedJoints {
    /// First joint of the left or the right arm.
    pub(crate) fn arm_start(&self, side: usize) -> usize {
        self.body_count + side * self.arm_count
    }
}

impl Source<'_> {
    /// Finds the commanded joints in the tree. Each must be of a kind that can be commanded. Every other movable
    /// joint must be held, so that no motion is left out of the model.
    pub(crate) fn find_joints(&self, file: &RobotFile, tree: &Tree) -> Result<CommandedJoints, RobotError> {
        let mut body: Vec<(usize, usize)> = Vec::new();
        for name in &file.body_joints {
            let at = self.find("body_joints", name, tree)?;
            body.push((depth(tree, at), at));
        }
        // The sort is stable, so joints of one depth stay in the file's order.
        body.sort_by_key(|(depth, _)| *depth);
        let mut at: Vec<usize> = body.into_iter().map(|(_, at)| at).collect();
        let body_count = at.len();
        let arm_count = file.arms.left.joints.len();
        if file.arms.right.joints.len() != arm_count || !(ARM_JOINTS_MIN..=ARM_JOINTS).contains(&arm_count) {
            let value = format!("{arm_count} and {} joints", file.arms.right.joints.len());
            let bound = format!("must be {ARM_JOINTS_MIN} to {ARM_JOINTS}, and as many left as right");
            return Err(self.value("arms.left.joints and arms.right.joints", value, bound));
        }
        for (key, arm) in [("arms.left.joints", &file.arms.left), ("arms.right.joints", &file.arms.right)] {
            for name in &arm.joints {
                at.push(self.find(key, name, tree)?);
            }
        }
        if at.len() > JOINTS_MAX {
            let (file, key) = (self.toml.into(), "commanded joints".into());
            return Err(RobotError::TooMany { file, key, count: at.len(), bound: JOINTS_MAX });
        }
        let mut prismatic = [false; JOINTS_MAX];
        for (j, index) in at.iter().enumerate() {
            let joint = &tree.joints[*index];
            if at[..j].contains(index) {
                return Err(RobotError::duplicate(self.toml, "joint", &joint.name));
            }
            prismatic[j] = joint.kind == JointType::Prismatic;
            let (fits, bound) = if j < body_count {
                (prismatic[j] || joint.kind == JointType::Revolute, "a body joint must be revolute or prismatic")
            } else {
                (joint.kind == JointType::Revolute, "an arm's joint must be revolute")
            };
            if !fits || joint.mimics.is_some() {
                let follows = joint.mimics.as_ref().map(|mimic| format!("mimic of `{}`", mimic.leader));
                return Err(self.joint_kind(joint, follows.filter(|_| fits).unwrap_or_else(|| kind_of(joint)), bound));
            }
        }
        let held = self.held(file, &at, tree)?;
        let names = at.iter().map(|index| tree.joints[*index].name.clone()).collect();
        Ok(CommandedJoints { names, at, body_count, arm_count, prismatic, held })
    }

    fn find(&self, key: &str, name: &str, tree: &Tree) -> Result<usize, RobotError> {
        tree.joint(name).ok_or_else(|| RobotError::unknown(self.toml, key, name, "a joint of the URDF"))
    }

    fn joint_kind(&self, joint: &UrdfJoint, value: String, bound: &str) -> RobotError {
        let (file, joint) = (self.line(joint), joint.name.clone());
        RobotError::JointKind { file, joint, value, bound: bound.into() }
    }

    fn held(&self, file: &RobotFile, at: &[usize], tree: &Tree) -> Result<BTreeMap<usize, f64>, RobotError> {
        let mut held = BTreeMap::new();
        for (table, slides, given) in [("held_m", true, &file.held_m), ("held_rad", false, &file.held_rad)] {
            for (name, &position) in given {
                let known = tree.joint(name).filter(|index| {
                    let kind = &tree.joints[*index].kind;
                    !at.contains(index) && *kind != JointType::Fixed && (*kind == JointType::Prismatic) == slides
                });
                let expected = if slides { "a joint that slides" } else { "a joint that turns" };
                let index = known.ok_or_else(|| {
                    let expected = format!("{expected} and is not commanded");
                    RobotError::unknown(self.toml, table, name, &expected)
                })?;
                let joint = &tree.joints[index];
                let leads = |mimic: &&Mimic| at.iter().any(|index| tree.joints[*index].name == mimic.leader);
                if let Some(mimic) = joint.mimics.as_ref().filter(leads) {
                    let bound = "a held joint must not follow a commanded one";
                    return Err(self.joint_kind(joint, format!("mimic of `{}`", mimic.leader), bound));
                }
                let [lower, upper] = joint.stops();
                if !(position >= lower && position <= upper) {
                    let bound = format!("must be within the URDF's [{lower}, {upper}]");
                    return Err(self.joint(self.toml, name, table, position, bound));
                }
                held.insert(index, position);
            }
        }
        self.check_followers(&held, tree)?;
        for (index, joint) in tree.joints.iter().enumerate() {
            if joint.kind == JointType::Fixed || at.contains(&index) || held.contains_key(&index) {
                continue;
            }
            let bound = "every movable joint must be commanded, or held: name it in [held_rad] or [held_m] of the \
                         robot file";
            return Err(self.joint_kind(joint, kind_of(joint), bound));
        }
        Ok(held)
    }

    /// Refuses a held joint that does not stand where its leader moves it.
    fn check_followers(&self, held: &BTreeMap<usize, f64>, tree: &Tree) -> Result<(), RobotError> {
        let mut errors = Vec::new();
        for (&index, &position) in held {
            let joint = &tree.joints[index];
            let Some(follows) = joint.follows(|leader| held.get(&tree.joint(leader)?).copied()) else { continue };
            if !((position - follows).abs() <= FOLLOWS) {
                let leader = joint.mimics.as_ref().map_or("", |mimic| mimic.leader.as_str());
                let bound = format!("must be {follows}: the URDF lets it follow `{leader}`");
                errors.push(self.joint(self.toml, &joint.name, "held position", position, bound));
            }
        }
        RobotError::all(errors)
    }

    /// Cuts the tree at the commanded joints. The result is a body for each joint and one for the base, and the
    /// place of every link on one of them.
    pub(crate) fn split_bodies(
        &self,
        (base_link, height_m): (&str, f64),
        commanded: &CommandedJoints,
        tree: &Tree,
    ) -> Result<(Vec<JointFrame>, Vec<BodyLink>), RobotError> {
        if tree.link(base_link) != Some(tree.root) {
            let bound = format!("must be the root link `{}`", tree.links[tree.root]);
            return Err(self.value("base_link", format!("`{base_link}`"), bound));
        }
        if !BASE_HEIGHT_M.contains(&height_m) {
            let bound = format!("must lie in [{}, {}]", BASE_HEIGHT_M.start(), BASE_HEIGHT_M.end());
            return Err(self.value("base_height_m", schema::short(height_m), bound));
        }
        let base_from_root = Pose { t: Vector3::new(0.0, 0.0, height_m), ..Pose::identity() };
        let locate = |link: usize| {
            let mut here = (link, Pose::identity());
            loop {
                let Some(above) = tree.joint_above[here.0] else {
                    return (0, base_from_root.compose(&here.1));
                };
                if let Some(j) = commanded.at.iter().position(|commanded| *commanded == above) {
                    return (j + 1, here.1);
                }
                let joint = &tree.joints[above];
                let held =
                    commanded.held.get(&above).map_or(here.1, |position| moved(joint, *position).compose(&here.1));
                here = (joint.parent, joint.parent_from_joint.compose(&held));
            }
        };
        let mut frames = Vec::with_capacity(commanded.at.len());
        for (j, index) in commanded.at.iter().enumerate() {
            let joint = &tree.joints[*index];
            let (parent, parent_from_link) = locate(joint.parent);
            if parent > j.min(commanded.body_count) && j < commanded.body_count {
                return Err(self.value("body_joints", format!("`{}`", joint.name), "must not be a part of an arm"));
            }
            let parent_from_joint = parent_from_link.compose(&joint.parent_from_joint);
            frames.push(JointFrame::new(parent, &parent_from_joint, joint.axis, commanded.prismatic[j]));
        }
        let links = (0..tree.links.len()).map(|link| {
            let (body, body_from_link) = locate(link);
            let (visuals, meshes) = (tree.visuals[link].clone(), tree.meshes[link].clone());
            BodyLink {
                name: tree.links[link].clone(),
                body,
                body_from_link,
                visuals,
                meshes,
                inertia: tree.inertias[link],
            }
        });
        Ok((frames, links.collect()))
    }

    /// The shape of both arms, which must be the same.
    pub(crate) fn arms_shape(
        &self,
        arms: &ArmEntries,
        commanded: &CommandedJoints,
        torso_body: usize,
        bodies: (&[JointFrame], &[BodyLink]),
    ) -> Result<ArmShape, RobotError> {
        let [left, right] = [(0, &arms.left), (1, &arms.right)];
        let shape = |(side, arm)| self.arm_shape(side, arm, commanded, torso_body, bodies);
        let (left, right) = (shape(left)?, shape(right)?);
        if left == right {
            return Ok(left);
        }
        let key = "joints that turn upper arm, forearm and hand, left and right";
        Err(self.value(key, format!("{left} and {right}"), "must be equal"))
    }

    /// Checks that an arm is one chain from the torso, and returns how many joints turn its upper arm, its forearm and its hand.
    /// The links of both limbs say so.
    fn arm_shape(
        &self,
        side: usize,
        arm: &ArmEntry,
        commanded: &CommandedJoints,
        torso_body: usize,
        (frames, links): (&[JointFrame], &[BodyLink]),
    ) -> Result<ArmShape, RobotError> {
        let (start, side) = (commanded.arm_start(side), ["left", "right"][side]);
        for i in 0..commanded.arm_count {
            let parent = frames[start + i].parent;
            let fits = if i == 0 { parent == torso_body } else { parent == start + i };
            if !fits {
                let bound = match i.checked_sub(1) {
                    None => "must be the first joint after torso_link".to_owned(),
                    Some(before) => format!("must be the next joint after `{}`", commanded.names[start + before]),
                };
                return Err(self.value(&format!("arms.{side}.joints"), format!("`{}`", arm.joints[i]), bound));
            }
        }
        // The number of joints up to the one that moves a limb.
        let upto = |part: &str, name: &str, counts: RangeInclusive<usize>| {
            let key = format!("arms.{side}.{part}");
            let found = links.iter().find(|link| link.name == *name).ok_or_else(|| self.unknown_link(&key, name))?;
            let count = found.body.saturating_sub(start);
            if counts.contains(&count) && count <= commanded.arm_count {
                return Ok(count);
            }
            let own = &commanded.names[start..start + commanded.arm_count];
            let names = counts.filter_map(|count| own.get(count.checked_sub(1)?));
            let names: Vec<_> = names.map(|name| format!("`{name}`")).collect();
            let bound = format!("must move with joint {}", names.join(" or "));
            Err(self.value(&key, format!("`{name}`"), bound))
        };
        let most = ArmShape::MOST;
        let upper = upto("upper", &arm.upper, 2..=most.upper)?;
        let limbs = upto("fore", &arm.fore, upper + 1..=upper + most.fore)?;
        let hand = commanded.arm_count - limbs;
        if hand > most.hand {
            let bound = format!("at most {} joints after `{}`: they turn the hand", most.hand, arm.fore);
            return Err(self.value(&format!("arms.{side}.joints"), format!("{hand} joints"), bound));
        }
        if arm.reference_rad.len() != limbs {
            let value = format!("{} positions", arm.reference_rad.len());
            let bound = format!("must be {limbs}: one for each joint up to `{}`", arm.fore);
            return Err(self.value(&format!("arms.{side}.reference_rad"), value, bound));
        }
        Ok(ArmShape { upper, fore: limbs - upper, hand })
    }
}

fn kind_of(joint: &UrdfJoint) -> String {
    crate::urdf::kind_name(&joint.kind)
}

fn depth(tree: &Tree, joint: usize) -> usize {
    let above = |at: &usize| tree.joint_above[tree.joints[*at].parent];
    std::iter::successors(Some(joint), above).count() - 1
}

/// Motion of a joint at a position, rad or m.
pub(crate) fn moved(joint: &UrdfJoint, position: f64) -> Pose {
    if joint.kind == JointType::Prismatic {
        Pose { t: joint.axis * position, ..Pose::identity() }
    } else {
        Pose { r: rotation(&joint.axis, position), ..Pose::identity() }
    }
}
