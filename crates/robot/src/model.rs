//! The checked model of one robot.

use crate::arm::{Arm, ArmShape};
use crate::collision::{AllowedPair, Capsule, Pair, read_capsules, read_pairs};
use crate::commanded::CommandedJoints;
use crate::environment::Obstacle;
use crate::error::RobotError;
use crate::file::{ArmEntry, CapsuleEntry, ControllerEntry, RobotFile};
use crate::gripper::Gripper;
use crate::inertia::Inertia;
use crate::kinematics::{Frames, JointFrame};
use crate::limits::JointLimits;
use crate::payload::Payload;
use crate::pointing::PointingJoints;
use crate::pose::Pose;
use crate::proposal::Proposal;
use crate::urdf::{Tree, UrdfJoint};
use crate::visual::{MeshVisual, Visual};
use messages::{JOINTS_MAX, RobotId};
use nalgebra::Matrix3;
use sha2::{Digest, Sha256};
use std::collections::BTreeMap;
use std::f64::consts::TAU;
use std::ops::RangeInclusive;
use std::sync::Arc;

/// Largest weight of a task, and the inverse of a joint's smallest weight. It keeps the quadratic program far
/// from its rounding.
const WEIGHT_MAX: f64 = 1e3;

/// Largest element of a rotation matrix minus the identity that counts as rounding of the URDF's text.
const TURN_TOLERANCE: f64 = 1e-6;

/// The two texts from which a model was made, for other readers.
#[derive(Debug)]
#[allow(missing_docs, reason = "the names say it")]
pub struct Texts {
    pub toml_name: String,
    pub toml: String,
    pub urdf_name: String,
    pub urdf: String,
}

/// Everything about one robot that does not change while it moves.
#[derive(Clone, Debug)]
pub struct Model {
    /// The texts from which it was made.
    pub texts: Arc<Texts>,
    /// Name of the robot. It is the same in both files.
    pub name: String,
    /// The first 8 bytes of the SHA-256 of both texts. Equal hashes mean equal robots.
    pub hash: u64,
    /// Number of commanded joints. Arrays of joints are longer: beyond this number stand joints that are not
    /// there. They stay at zero, carry nothing, and cannot be commanded.
    pub count: usize,
    /// Number of body joints (lift, waist, head). They come first, then the left arm, then the right arm.
    pub body_count: usize,
    /// The body joint that lifts the torso. None if the torso does not slide.
    pub lift: Option<usize>,
    /// URDF names of the commanded joints, in the order of messages.
    pub joint_names: Vec<String>,
    /// The robot's controllers. Every commanded joint belongs to one of them.
    pub controllers: Vec<Controller>,
    /// How the robot file proposes to drive it.
    pub driver: Proposal,
    /// True for joints that slide (m), false for joints that turn (rad).
    pub prismatic: [bool; JOINTS_MAX],
    /// Limits in force: the URDF's, tightened by the robot file.
    pub limits: [JointLimits; JOINTS_MAX],
    /// Limits of the URDF. Acceleration and jerk are infinite if it gives none.
    pub urdf_limits: [JointLimits; JOINTS_MAX],
    /// Home posture: used for every joint that has no target, rad or m.
    pub home: [f64; JOINTS_MAX],
    /// The arms are checked to mirror each other, up to a sign per joint.
    pub mirrored: bool,
    /// Left and right arm.
    pub arms: [Arm; 2],
    /// Joints 6 and 7 of the left and the right arm. They turn the hand.
    pub wrists: [PointingJoints; 2],
    /// The joints that turn the head. None if the robot file names none.
    pub head: Option<PointingJoints>,
    /// The body whose frame is the torso frame of the limb rotations.
    pub torso_body: usize,
    /// The torso frame (x forward, y left, z up) in that body's.
    pub(crate) body_from_torso: Matrix3<f64>,
    /// Collision geometry.
    pub capsules: Vec<Capsule>,
    /// The pairs that are checked, in ascending order.
    pub pairs: Vec<Pair>,
    /// The pairs that are not checked, with reasons.
    pub allowed: Vec<AllowedPair>,
    /// Obstacles around the robot, see [`Model::with_environment`]. Every moving capsule is checked against
    /// each.
    pub obstacles: Vec<Obstacle>,
    /// Cost of a joint's deviation from its target where the robot is blocked, for a deviation as large as
    /// its largest speed.
    pub joint_weight: [f64; JOINTS_MAX],
    /// Cost of a deviation of a limb's angular velocity by 1 rad/s there. 0 leaves the limbs' rotations out.
    pub limb_weight: f64,
    /// Payload of the left and the right hand at the start. None if the robot file does not mention a hand.
    pub payload: [Option<Payload>; 2],
    /// Grippers of the left and the right hand. None if nothing commands the fingers.
    pub grippers: [Option<Gripper>; 2],
    /// Longest duration of a stop, s.
    pub stop_time_max_s: f64,
    /// Least distance of every checked pair in commands, m.
    pub d_min_m: f64,
    /// Measured postures below this clearance are a fault, m.
    pub d_measured_min_m: f64,
    pub(crate) joint_frames: Vec<JointFrame>,
    pub(crate) links: Vec<BodyLink>,
}

/// Joints that one controller of the robot moves together.
#[derive(Clone, Debug, PartialEq)]
pub struct Controller {
    /// The controller's own name.
    pub name: String,
    /// Bit j stands for joint j.
    pub joints: u32,
    /// The same joints in the order of the robot file.
    pub order: Vec<usize>,
}

/// Largest number of controllers. Robots with two arms have one to four, and two more for their grippers.
pub const CONTROLLERS_MAX: usize = 8;

/// Limits of a joint that is not there.
pub(crate) const NO_JOINT: JointLimits =
    JointLimits { q_min: -1.0, q_max: 1.0, v_max: 1.0, a_max: 10.0, j_max: 400.0, effort_max: 1.0 };

/// Position of a link of the URDF on its body.
#[derive(Clone, Debug)]
pub(crate) struct BodyLink {
    pub(crate) name: String,
    pub(crate) body: usize,
    pub(crate) body_from_link: Pose,
    /// Shapes in the link's own frame.
    pub(crate) visuals: Vec<Visual>,
    pub(crate) meshes: Vec<MeshVisual>,
    /// Mass properties in the link's own frame.
    pub(crate) inertia: Inertia,
}

impl Model {
    /// Makes a model from the texts of a robot file and of a URDF. The names are those of the files, for
    /// error messages.
    ///
    /// It refuses everything that would weaken a guarantee: texts that are not a tree of links, joints
    /// without plausible limits, overrides that loosen, and arms that only claim to mirror. It also refuses a home
    /// posture outside the limits or with too little clearance.
    ///
    /// ```
    /// let read = |kind| std::fs::read_to_string(format!("../../config/robots/tiago_dual.{kind}"));
    /// let model = robot::Model::from_text("tiago_dual.toml", &read("toml")?, "tiago_dual.urdf", &read("urdf")?)?;
    /// assert_eq!(model.joint_names[model.arms[0].range().start], "arm_left_1_joint");
    ///
    /// let refused = robot::Model::from_text("mine.toml", "name = 1", "mine.urdf", "").unwrap_err();
    /// assert!(refused.to_string().starts_with("mine.toml"));
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn from_text(toml_name: &str, toml_text: &str, urdf_name: &str, urdf_text: &str) -> Result<Self, RobotError> {
        Self::from_file(RobotFile::parse(toml_name, toml_text)?, [toml_name, toml_text, urdf_name, urdf_text])
    }

    /// Makes a model from a draft, with one capsule in place of those that it lacks.
    pub(crate) fn from_draft(
        toml_name: &str,
        toml_text: &str,
        urdf_name: &str,
        urdf_text: &str,
    ) -> Result<Self, RobotError> {
        let mut file = RobotFile::parse(toml_name, toml_text)?;
        let (name, link) = ("draft".to_owned(), file.base_link.clone());
        file.collision.capsules.push(CapsuleEntry { name, link, a_m: [0.0; 3], b_m: [0.0; 3], radius_m: 0.01 });
        Self::from_file(file, [toml_name, toml_text, urdf_name, urdf_text])
    }

    fn from_file(file: RobotFile, [toml_name, toml, urdf_name, urdf]: [&str; 4]) -> Result<Self, RobotError> {
        let mut tree = Tree::parse(urdf_name, urdf)?;
        let source = Source { toml: toml_name, urdf: urdf_name };
        source.supply(&file.supply, &mut tree)?;
        let [toml_name, toml, urdf_name, urdf] = [toml_name, toml, urdf_name, urdf].map(str::to_owned);
        source.build(file, &tree, Texts { toml_name, toml, urdf_name, urdf })
    }

    /// Number and order of the joints, for messages.
    pub fn id(&self) -> RobotId {
        RobotId { hash: self.hash, joint_count: self.count as u32, reserved: 0 }
    }

    /// Checks that no arm could collide unseen: upper arm, forearm and hand each have a capsule in a checked pair.
    /// A robot file before `collision fit` has none.
    pub fn check_guarded(&self) -> Result<(), RobotError> {
        let mut errors = Vec::new();
        for (side, arm) in ["left", "right"].into_iter().zip(&self.arms) {
            for (part, slots) in arm.parts() {
                let moved = |body: usize| slots.iter().flatten().any(|j| j + 1 == body);
                let guards = |at: usize| moved(self.capsules[at].body);
                if !self.pairs.iter().any(|pair| guards(pair.a) || guards(pair.b)) {
                    let links = self.links.iter().filter(|link| moved(link.body)).map(|link| link.name.as_str());
                    let bound = format!(
                        "must be at least 1: `collision fit` makes them of shapes of its links, {}. If the URDF has none, name \
                         one with shapes by a second --urdf",
                        links.collect::<Vec<_>>().join(", ")
                    );
                    let key = format!("checked pairs of capsules on the {side} {part}");
                    errors.push(RobotError::value(&self.texts.toml_name, key, "0", bound));
                }
            }
        }
        RobotError::all(errors)
    }

    /// A mask with every joint of the robot set.
    pub fn joint_mask(&self) -> u32 {
        (1 << self.count) - 1
    }
}

fn hash(toml_text: &str, urdf_text: &str) -> u64 {
    let mut hasher = Sha256::new();
    for text in [toml_text, urdf_text] {
        hasher.update((text.len() as u64).to_le_bytes());
        hasher.update(text);
    }
    let digest = hasher.finalize();
    u64::from_le_bytes(std::array::from_fn(|i| digest[i]))
}

pub(crate) struct Source<'a> {
    pub(crate) toml: &'a str,
    pub(crate) urdf: &'a str,
}

impl Source<'_> {
    fn build(&self, file: RobotFile, tree: &Tree, texts: Texts) -> Result<Model, RobotError> {
        let commanded = self.find_joints(&file, tree)?;
        let (joint_names, prismatic) = (&commanded.names, commanded.prismatic);
        let (joint_frames, links) = self.split_bodies((&file.base_link, file.base_height_m), &commanded, tree)?;
        let urdf_limits = self.urdf_limits(&commanded, tree)?;
        self.check_names("tighten", file.tighten.keys(), joint_names)?;
        let groups = self.groups(&file.limits, joint_names)?;
        let mut limits = urdf_limits;
        for (j, name) in joint_names.iter().enumerate() {
            let (tighten, stop_time_max_ms) = (file.tighten.get(name), file.limits.stop_time_max_ms);
            limits[j] = self.effective(name, prismatic[j], &urdf_limits[j], groups[j], tighten, stop_time_max_ms)?;
        }
        let home = self.home(&file.home_m, &file.home_rad, joint_names, &prismatic)?;

        let link_body = |name: &str| links.iter().find(|link| link.name == name).map(|l| (l.body, l.body_from_link));
        let capsules = read_capsules(self.toml, &file.collision.capsules, link_body)?;
        let parent = |body: usize| Some(joint_frames[body.checked_sub(1)?].parent);
        let (pairs, allowed) = read_pairs(self.toml, &capsules, &file.collision.allowed, parent)?;
        let (torso_body, body_from_torso) = self.torso(&file, link_body(&file.torso_link))?;
        let shape = self.arms_shape(&file.arms, &commanded, torso_body, (&joint_frames, &links))?;
        let lift = std::iter::successors(torso_body.checked_sub(1), |j| joint_frames[*j].parent.checked_sub(1))
            .find(|j| prismatic[*j]);
        let joint_weight = self.joint_weights(&file.tasks.joint_weight, joint_names)?;

        let mut model = Model {
            name: file.name,
            hash: hash(&texts.toml, &texts.urdf),
            texts: Arc::new(texts),
            count: commanded.at.len(),
            body_count: commanded.body_count,
            lift,
            controllers: self.controllers(&file.controllers, joint_names)?,
            driver: self.proposal(file.driver, joint_names, &prismatic)?,
            prismatic,
            limits,
            urdf_limits,
            home,
            mirrored: file.arms.mirrored.unwrap_or(true),
            arms: [Arm::blank(); 2],
            wrists: [PointingJoints::NONE; 2],
            head: None,
            torso_body,
            body_from_torso,
            capsules,
            pairs,
            allowed,
            obstacles: Vec::new(),
            limb_weight: self.weight(
                "tasks.limb_orientation_weight",
                file.tasks.limb_orientation_weight,
                0.0..=WEIGHT_MAX,
            )?,
            joint_weight,
            payload: self.payloads(&file.payload)?,
            grippers: self.grippers(file.hands, joint_names)?,
            stop_time_max_s: file.limits.stop_time_max_ms * 1e-3,
            d_min_m: self.millimetres("collision.clearance_min_mm", file.collision.clearance_min_mm)?,
            d_measured_min_m: self
                .millimetres("collision.clearance_measured_min_mm", file.collision.clearance_measured_min_mm)?,
            joint_frames,
            links,
            joint_names: commanded.names.clone(),
        };
        self.derive_arms([&file.arms.left, &file.arms.right], (&shape, &commanded), &mut model)?;
        model.head = self.head(file.head_joints.as_ref(), &model)?;
        self.check_masses(&model)?;
        self.check_home(&model)?;
        Ok(model)
    }

    fn joint_weights(&self, given: &BTreeMap<String, f64>, names: &[String]) -> Result<[f64; JOINTS_MAX], RobotError> {
        self.check_names("tasks.joint_weight", given.keys(), names)?;
        let mut weights = [1.0; JOINTS_MAX];
        for (weight, name) in weights.iter_mut().zip(names) {
            if let Some(&value) = given.get(name) {
                *weight = self.weight(&format!("tasks.joint_weight.{name}"), value, 1.0 / WEIGHT_MAX..=WEIGHT_MAX)?;
            }
        }
        Ok(weights)
    }

    fn weight(&self, key: &str, value: f64, bound: RangeInclusive<f64>) -> Result<f64, RobotError> {
        if bound.contains(&value) {
            return Ok(value);
        }
        let bound = format!("must lie in [{}, {}]", bound.start(), bound.end());
        Err(self.value(key, schema::short(value), bound))
    }

    pub(crate) fn value(&self, key: &str, value: String, bound: impl Into<String>) -> RobotError {
        RobotError::value(self.toml, key, value, bound)
    }

    /// The URDF with the line of a joint.
    pub(crate) fn line(&self, joint: &UrdfJoint) -> String {
        format!("{}: line {}", self.urdf, joint.line)
    }

    pub(crate) fn unknown_link(&self, key: &str, name: &str) -> RobotError {
        RobotError::unknown(self.toml, key, name, "a link of the URDF")
    }

    pub(crate) fn joint(&self, file: &str, joint: &str, key: &str, value: f64, bound: impl Into<String>) -> RobotError {
        let (file, joint, key) = (file.into(), joint.into(), key.into());
        RobotError::Joint { file, joint, key, value, bound: bound.into() }
    }

    pub(crate) fn check_names<'n>(
        &self,
        table: &str,
        mut names: impl Iterator<Item = &'n String>,
        joint_names: &[String],
    ) -> Result<(), RobotError> {
        let unknown = names.find(|name| !joint_names.contains(name));
        unknown.map_or(Ok(()), |name| Err(RobotError::unknown(self.toml, table, name, "a commanded joint")))
    }

    fn derive_arms(
        &self,
        arms: [&ArmEntry; 2],
        (shape, order): (&ArmShape, &CommandedJoints),
        model: &mut Model,
    ) -> Result<(), RobotError> {
        for (side, arm) in arms.into_iter().enumerate() {
            if let Some(value) = arm.reference_rad.iter().find(|value| !(value.abs() <= TAU)) {
                let key = format!("arms.{}.reference_rad", ["left", "right"][side]);
                return Err(self.value(&key, schema::short(*value), "at most 2 pi in magnitude"));
            }
            let joints = Arm::with_joints(order.arm_start(side), shape);
            model.arms[side] = model.derive_arm(&joints, shape.in_slots(&arm.reference_rad));
        }
        model.check_shoulders(self.urdf)?;
        if model.mirrored {
            model.mirror(self.toml)?;
        }
        let t_pose = model.t_pose();
        model.wrists = model.arms.each_ref().map(|arm| model.pointing(arm.hand_joints(), &t_pose));
        model.check_sides(self.toml)
    }

    /// Returns the body of the torso's link, and the torso frame of the limb rotations in the body's frame.
    fn torso(&self, file: &RobotFile, found: Option<(usize, Pose)>) -> Result<(usize, Matrix3<f64>), RobotError> {
        let (body, body_from_link) = found.ok_or_else(|| self.unknown_link("torso_link", &file.torso_link))?;
        if let Some(value) = file.torso_rpy_rad.iter().find(|angle| !(angle.abs() <= TAU)) {
            return Err(self.value("torso_rpy_rad", schema::short(*value), "at most 2 pi in magnitude"));
        }
        let link = Some(body_from_link.r).filter(|r| (r - Matrix3::identity()).amax() > TURN_TOLERANCE);
        let turn = Pose::from_xyz_rpy([0.0; 3], file.torso_rpy_rad).r;
        Ok((body, link.map_or(turn, |link| link * turn)))
    }

    /// Reads the controllers. Every joint belongs to exactly one.
    fn controllers(&self, entries: &[ControllerEntry], names: &[String]) -> Result<Vec<Controller>, RobotError> {
        if entries.is_empty() {
            let (joints, order) = ((1 << names.len()) - 1, (0..names.len()).collect());
            return Ok(vec![Controller { name: "joints".into(), joints, order }]);
        }
        if entries.len() > CONTROLLERS_MAX {
            let (file, key) = (self.toml.into(), "controllers".into());
            return Err(RobotError::TooMany { file, key, count: entries.len(), bound: CONTROLLERS_MAX });
        }
        let lists = entries.iter().map(|entry| (format!("controllers `{}`", entry.name), entry.joints.as_slice()));
        let owners = self.partition(lists, names, "a controller")?;
        let masks = |c: usize| owners.iter().enumerate().filter(|(_, owner)| **owner == c).map(|(j, _)| 1 << j).sum();
        let place = |name: &String| names.iter().position(|known| known == name);
        let read = |(c, entry): (usize, &ControllerEntry)| {
            let order = entry.joints.iter().filter_map(place).collect();
            Controller { name: entry.name.clone(), joints: masks(c), order }
        };
        Ok(entries.iter().enumerate().map(read).collect())
    }

    /// Finds the list of each joint. Every joint must be in exactly one list.
    pub(crate) fn partition<'l>(
        &self,
        lists: impl Iterator<Item = (String, &'l [String])>,
        names: &[String],
        what: &str,
    ) -> Result<Vec<usize>, RobotError> {
        let mut owners: Vec<Option<usize>> = vec![None; names.len()];
        for (index, (key, list)) in lists.enumerate() {
            for name in list {
                let j = names.iter().position(|known| known == name);
                let j = j.ok_or_else(|| RobotError::unknown(self.toml, key.as_str(), name, "a commanded joint"))?;
                if owners[j].replace(index).is_some() {
                    return Err(RobotError::duplicate(self.toml, &format!("{key}: joint"), name));
                }
            }
        }
        let found = |(j, owner): (usize, Option<usize>)| {
            let missing = || self.value("joints", format!("`{}`", names[j]), format!("must belong to {what}"));
            owner.ok_or_else(missing)
        };
        owners.into_iter().enumerate().map(found).collect()
    }

    fn home(
        &self,
        metres: &BTreeMap<String, f64>,
        radians: &BTreeMap<String, f64>,
        names: &[String],
        prismatic: &[bool; JOINTS_MAX],
    ) -> Result<[f64; JOINTS_MAX], RobotError> {
        self.check_names("home_m", metres.keys(), names)?;
        self.check_names("home_rad", radians.keys(), names)?;
        let mut home = [0.0; JOINTS_MAX];
        for j in 0..names.len() {
            let (table, key, foreign) =
                if prismatic[j] { (metres, "home_m", radians) } else { (radians, "home_rad", metres) };
            if let Some(value) = foreign.get(&names[j]) {
                return Err(self.joint(self.toml, &names[j], "home", *value, format!("belongs in [{key}]")));
            }
            home[j] = *table.get(&names[j]).ok_or_else(|| {
                self.value(key, "missing".into(), format!("joint `{}` must have a home position", names[j]))
            })?;
            if !home[j].is_finite() {
                return Err(self.joint(self.toml, &names[j], key, home[j], "must be a number"));
            }
        }
        Ok(home)
    }

    /// 1 mm is less than any servo can hold, and 200 mm is more than a forearm.
    fn millimetres(&self, key: &str, value: f64) -> Result<f64, RobotError> {
        if !(1.0..=200.0).contains(&value) {
            return Err(self.value(key, schema::short(value), "must be 1 to 200"));
        }
        Ok(value * 1e-3)
    }

    /// Checks the home posture. Every joint without a target goes there, so it must be reachable and free.
    fn check_home(&self, model: &Model) -> Result<(), RobotError> {
        if model.d_measured_min_m > model.d_min_m {
            let value = (model.d_measured_min_m * 1e3).to_string();
            let bound = format!(
                "at most clearance_min_mm = {}, or every command at the margin would be a fault",
                model.d_min_m * 1e3
            );
            return Err(self.value("collision.clearance_measured_min_mm", value, bound));
        }
        for j in 0..model.count {
            let limits = &model.limits[j];
            if !limits.contains(model.home[j]) {
                let bound = format!("must be within [{}, {}]", limits.q_min, limits.q_max);
                return Err(self.joint(self.toml, &model.joint_names[j], "home", model.home[j], bound));
            }
        }
        let mut frames = Frames::default();
        model.forward(&model.home, &mut frames);
        let (clearance_m, index) = model.clearance(&frames);
        if !(clearance_m >= model.d_min_m) {
            let pair = model.pairs[index];
            let key =
                format!("home: clearance of `{}` and `{}`", model.capsules[pair.a].name, model.capsules[pair.b].name);
            let bound = format!("must be at least collision.clearance_min_mm = {} mm", model.d_min_m * 1e3);
            return Err(self.value(&key, format!("{:.1} mm", clearance_m * 1e3), bound));
        }
        Ok(())
    }
}
