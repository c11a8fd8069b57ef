//! The checked model of one robot.

use crate::arm::Arm;
use crate::collision::{AllowedPair, Capsule, Pair, read_capsules, read_pairs};
use crate::environment::Obstacle;
use crate::error::RobotError;
use crate::file::{Limb, RobotFile};
use crate::inertia::Inertia;
use crate::kinematics::{Frames, JointFrame};
use crate::limits::JointLimits;
use crate::payload::Payload;
use crate::pose::Pose;
use crate::urdf::Tree;
use crate::visual::{MeshVisual, Visual};
use messages::{ARM_JOINTS, JOINTS, LEFT_ARM, RIGHT_ARM, TORSO};
use sha2::{Digest, Sha256};
use std::collections::BTreeMap;
use std::ops::RangeInclusive;
use std::sync::Arc;
use urdf_rs::JointType;

/// Largest weight of a task, and the inverse of a joint's smallest weight. It keeps the quadratic program far
/// from its rounding.
const WEIGHT_MAX: f64 = 1e3;

/// The two texts from which a model was made, for other readers.
#[derive(Debug)]
pub struct Texts {
    /// Name of the robot file, for error messages.
    pub toml_name: String,
    /// The robot file.
    pub toml: String,
    /// Name of the URDF, for error messages.
    pub urdf_name: String,
    /// The URDF.
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
    /// URDF names of the 17 joints in the fixed joint order.
    pub joint_names: [String; JOINTS],
    /// True for joints that slide (m), false for joints that turn (rad).
    pub prismatic: [bool; JOINTS],
    /// Limits in force: the URDF's, tightened by the robot file.
    pub limits: [JointLimits; JOINTS],
    /// Limits of the URDF. Acceleration and jerk are infinite if it gives none.
    pub urdf_limits: [JointLimits; JOINTS],
    /// Home posture: used for every joint that has no target, rad or m.
    pub home: [f64; JOINTS],
    /// Left and right arm. The right one is checked to be the mirror image of the left.
    pub arms: [Arm; 2],
    /// The body whose frame is the torso frame of the limb rotations.
    pub torso_body: usize,
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
    pub joint_weight: [f64; JOINTS],
    /// Cost of a deviation of a limb's angular velocity by 1 rad/s there. 0 leaves the limbs' rotations out.
    pub limb_weight: f64,
    /// Payload of the left and the right hand at the start. None if the robot file does not mention a hand.
    pub payload: [Option<Payload>; 2],
    /// Longest duration of a stop, s.
    pub stop_time_max_s: f64,
    /// Least distance of every checked pair in commands, m.
    pub d_min_m: f64,
    /// Measured postures below this clearance are a fault, m.
    pub d_measured_min_m: f64,
    pub(crate) joint_frames: Vec<JointFrame>,
    pub(crate) links: Vec<Link>,
}

/// Position of a link of the URDF on its body.
#[derive(Clone, Debug)]
pub(crate) struct Link {
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
    /// without plausible limits, overrides that loosen, and arms that do not mirror. It also refuses a home
    /// posture outside the limits or with too little clearance.
    ///
    /// ```
    /// let read = |kind| std::fs::read_to_string(format!("../../config/robots/tiago_dual.{kind}"));
    /// let model = robot::Model::from_text("tiago_dual.toml", &read("toml")?, "tiago_dual.urdf", &read("urdf")?)?;
    /// assert_eq!(model.joint_names[messages::LEFT_ARM.start], "arm_left_1_joint");
    ///
    /// let refused = robot::Model::from_text("mine.toml", "name = 1", "mine.urdf", "").unwrap_err();
    /// assert!(refused.to_string().starts_with("mine.toml"));
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn from_text(toml_name: &str, toml_text: &str, urdf_name: &str, urdf_text: &str) -> Result<Self, RobotError> {
        let file = RobotFile::parse(toml_name, toml_text)?;
        let tree = Tree::parse(urdf_name, urdf_text)?;
        let source = Source { toml: toml_name, urdf: urdf_name };
        let texts = Texts {
            toml_name: toml_name.to_owned(),
            toml: toml_text.to_owned(),
            urdf_name: urdf_name.to_owned(),
            urdf: urdf_text.to_owned(),
        };
        source.build(file, &tree, texts)
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

/// Names of the two files, for error messages.
pub(crate) struct Source<'a> {
    pub(crate) toml: &'a str,
    pub(crate) urdf: &'a str,
}

impl Source<'_> {
    fn build(&self, file: RobotFile, tree: &Tree, texts: Texts) -> Result<Model, RobotError> {
        let joint_names = file.joints.ordered();
        let at = self.find_joints(&joint_names, tree)?;
        let prismatic = std::array::from_fn(|j| tree.joints[at[j]].kind == JointType::Prismatic);
        self.check_other_joints(&file.held_joints, &at, tree)?;
        let (joint_frames, links) = self.split_bodies(&file.base_link, &at, &prismatic, tree)?;

        let urdf_limits = self.urdf_limits(&at, &prismatic, tree)?;
        self.check_names("tighten", file.tighten.keys(), &joint_names)?;
        let mut limits = urdf_limits;
        for j in 0..JOINTS {
            let tighten = file.tighten.get(&joint_names[j]);
            limits[j] = self.effective(j, &joint_names[j], prismatic[j], &urdf_limits[j], &file.limits, tighten)?;
        }
        let home = self.home(&file.home_m, &file.home_rad, &joint_names, &prismatic)?;

        let link_body = |name: &str| links.iter().find(|link| link.name == name).map(|l| (l.body, l.body_from_link));
        let capsules = read_capsules(self.toml, &file.collision.capsules, link_body)?;
        let parent = |body: usize| body.checked_sub(1).map(|j| joint_frames[j].parent);
        let (pairs, allowed) = read_pairs(self.toml, &capsules, &file.collision.allowed, parent)?;
        let torso_body =
            link_body(&file.torso_link).ok_or_else(|| self.unknown_link("torso_link", &file.torso_link))?.0;
        self.check_limb("left", &file.limbs.left, LEFT_ARM.start, &links, &joint_names)?;
        self.check_limb("right", &file.limbs.right, RIGHT_ARM.start, &links, &joint_names)?;

        let joint_weight = self.joint_weights(&file.tasks.joint_weight, &joint_names)?;

        let mut model = Model {
            name: file.name,
            hash: hash(&texts.toml, &texts.urdf),
            texts: Arc::new(texts),
            joint_names,
            prismatic,
            limits,
            urdf_limits,
            home,
            arms: [Arm::blank(); 2],
            torso_body,
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
            stop_time_max_s: file.limits.stop_time_max_ms * 1e-3,
            d_min_m: self.millimetres("collision.clearance_min_mm", file.collision.clearance_min_mm)?,
            d_measured_min_m: self
                .millimetres("collision.clearance_measured_min_mm", file.collision.clearance_measured_min_mm)?,
            joint_frames,
            links,
        };
        self.derive_arms(&file.reference_rad, &mut model)?;
        self.check_home(&model)?;
        Ok(model)
    }

    fn joint_weights(
        &self,
        given: &BTreeMap<String, f64>,
        names: &[String; JOINTS],
    ) -> Result<[f64; JOINTS], RobotError> {
        self.check_names("tasks.joint_weight", given.keys(), names)?;
        let mut weights = [1.0; JOINTS];
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
        Err(self.value(key, value.to_string(), bound))
    }

    fn derive_arms(&self, reference_rad: &BTreeMap<String, f64>, model: &mut Model) -> Result<(), RobotError> {
        self.check_names("reference_rad", reference_rad.keys(), &model.joint_names)?;
        for (side, range) in [LEFT_ARM, RIGHT_ARM].into_iter().enumerate() {
            let joints: [usize; ARM_JOINTS] = std::array::from_fn(|i| range.start + i);
            let reference = self.reference(reference_rad, &joints[..5], &model.joint_names)?;
            model.arms[side] = model.derive_arm(joints, reference, model.torso_body);
        }
        model.check_mirror(self.urdf)
    }

    /// Checks that the upper arm moves with the arm's third joint, and the forearm with its fifth.
    fn check_limb(
        &self,
        side: &str,
        limb: &Limb,
        arm_start: usize,
        links: &[Link],
        joint_names: &[String; JOINTS],
    ) -> Result<(), RobotError> {
        for (part, name, joint) in [("upper", &limb.upper, arm_start + 2), ("fore", &limb.fore, arm_start + 4)] {
            let key = format!("limbs.{side}.{part}");
            let found = links.iter().find(|link| link.name == *name).ok_or_else(|| self.unknown_link(&key, name))?;
            if found.body != joint + 1 {
                let bound = format!("must move with joint `{}`", joint_names[joint]);
                return Err(self.value(&key, format!("`{name}`"), bound));
            }
        }
        Ok(())
    }

    pub(crate) fn value(&self, key: &str, value: String, bound: impl Into<String>) -> RobotError {
        RobotError::value(self.toml, key, value, bound)
    }

    fn unknown_link(&self, key: &str, name: &str) -> RobotError {
        RobotError::unknown(self.toml, key, name, "a link of the URDF")
    }

    pub(crate) fn joint(&self, file: &str, joint: &str, key: &str, value: f64, bound: impl Into<String>) -> RobotError {
        let (file, joint, key) = (file.into(), joint.into(), key.into());
        RobotError::Joint { file, joint, key, value, bound: bound.into() }
    }

    fn check_names<'n>(
        &self,
        table: &str,
        mut names: impl Iterator<Item = &'n String>,
        joint_names: &[String; JOINTS],
    ) -> Result<(), RobotError> {
        let unknown = names.find(|name| !joint_names.contains(name));
        unknown.map_or(Ok(()), |name| Err(RobotError::unknown(self.toml, table, name, "a commanded joint")))
    }

    /// Finds the commanded joints in the tree. Each must be of a kind that can be commanded.
    fn find_joints(&self, names: &[String; JOINTS], tree: &Tree) -> Result<[usize; JOINTS], RobotError> {
        let mut at = [0; JOINTS];
        for (j, name) in names.iter().enumerate() {
            at[j] = tree
                .joint(name)
                .ok_or_else(|| RobotError::unknown(self.toml, "joints", name, "a joint of the URDF"))?;
            if at[..j].contains(&at[j]) {
                return Err(RobotError::duplicate(self.toml, "joint", name));
            }
            let joint = &tree.joints[at[j]];
            let (wanted, bound) = if j == TORSO {
                (JointType::Prismatic, "the torso lift must be prismatic")
            } else {
                (JointType::Revolute, "head and arm joints must be revolute")
            };
            let value = match &joint.kind {
                kind if *kind != wanted => format!("{kind:?}").to_lowercase(),
                _ if joint.mimics => "mimic".into(),
                _ => continue,
            };
            let (file, joint) = (self.urdf.into(), name.clone());
            return Err(RobotError::JointKind { file, joint, value, bound: bound.into() });
        }
        Ok(at)
    }

    /// Checks that every movable joint is commanded or declared as held, so that no motion is left out of the
    /// model.
    fn check_other_joints(&self, held: &[String], at: &[usize; JOINTS], tree: &Tree) -> Result<(), RobotError> {
        for name in held {
            let known = tree.joint(name).filter(|joint| !at.contains(joint));
            if known.is_none() {
                let expected = "a joint of the URDF that is not commanded";
                return Err(RobotError::unknown(self.toml, "held_joints", name, expected));
            }
        }
        for (index, joint) in tree.joints.iter().enumerate() {
            if joint.kind != JointType::Fixed && !at.contains(&index) && !held.contains(&joint.name) {
                return Err(RobotError::JointKind {
                    file: self.urdf.into(),
                    joint: joint.name.clone(),
                    value: format!("{:?}", joint.kind).to_lowercase(),
                    bound: "every movable joint must be commanded, or listed in held_joints of the robot file".into(),
                });
            }
        }
        Ok(())
    }

    /// Cuts the tree at the commanded joints. The result is 18 bodies, and the place of every link on one of
    /// them.
    fn split_bodies(
        &self,
        base_link: &str,
        at: &[usize; JOINTS],
        prismatic: &[bool; JOINTS],
        tree: &Tree,
    ) -> Result<(Vec<JointFrame>, Vec<Link>), RobotError> {
        if tree.link(base_link) != Some(tree.root) {
            let bound = format!("must be the root link `{}`", tree.links[tree.root]);
            return Err(self.value("base_link", format!("`{base_link}`"), bound));
        }
        let locate = |link: usize| {
            let mut here = (link, Pose::identity());
            loop {
                let Some(joint) = tree.joint_above[here.0] else {
                    return (0, here.1);
                };
                if let Some(j) = at.iter().position(|commanded| *commanded == joint) {
                    return (j + 1, here.1);
                }
                let joint = &tree.joints[joint];
                here = (joint.parent, joint.parent_from_joint.compose(&here.1));
            }
        };
        let mut frames = Vec::with_capacity(JOINTS);
        for (j, index) in at.iter().enumerate() {
            let joint = &tree.joints[*index];
            let (parent, parent_from_link) = locate(joint.parent);
            if parent > j {
                let bound = "must not be attached to a later joint in the order torso, head, left arm, right arm";
                return Err(self.value("joints", format!("`{}`", joint.name), bound));
            }
            let parent_from_joint = parent_from_link.compose(&joint.parent_from_joint);
            frames.push(JointFrame::new(parent, &parent_from_joint, joint.axis, prismatic[j]));
        }
        let links = (0..tree.links.len()).map(|link| {
            let (body, body_from_link) = locate(link);
            let (visuals, meshes) = (tree.visuals[link].clone(), tree.meshes[link].clone());
            Link { name: tree.links[link].clone(), body, body_from_link, visuals, meshes, inertia: tree.inertias[link] }
        });
        Ok((frames, links.collect()))
    }

    fn home(
        &self,
        metres: &BTreeMap<String, f64>,
        radians: &BTreeMap<String, f64>,
        names: &[String; JOINTS],
        prismatic: &[bool; JOINTS],
    ) -> Result<[f64; JOINTS], RobotError> {
        self.check_names("home_m", metres.keys(), names)?;
        self.check_names("home_rad", radians.keys(), names)?;
        let mut home = [0.0; JOINTS];
        for j in 0..JOINTS {
            let (table, key, foreign) =
                if prismatic[j] { (metres, "home_m", radians) } else { (radians, "home_rad", metres) };
            if let Some(value) = foreign.get(&names[j]) {
                return Err(self.joint(self.toml, &names[j], "home", *value, format!("belongs in [{key}]")));
            }
            home[j] = *table.get(&names[j]).ok_or_else(|| {
                self.value(key, "missing".into(), format!("joint `{}` must have a home position", names[j]))
            })?;
        }
        Ok(home)
    }

    fn reference(
        &self,
        table: &BTreeMap<String, f64>,
        joints: &[usize],
        names: &[String; JOINTS],
    ) -> Result<[f64; 5], RobotError> {
        let mut reference = [0.0; 5];
        for (value, j) in reference.iter_mut().zip(joints) {
            let name = &names[*j];
            *value = *table.get(name).ok_or_else(|| {
                let bound = format!("joint `{name}` must have a position in the T-pose");
                self.value("reference_rad", "missing".into(), bound)
            })?;
            if !value.is_finite() {
                return Err(self.joint(self.toml, name, "reference_rad", *value, "must be finite"));
            }
        }
        Ok(reference)
    }

    /// 1 mm is less than any servo can hold, and 200 mm is more than a forearm.
    fn millimetres(&self, key: &str, value: f64) -> Result<f64, RobotError> {
        if !(1.0..=200.0).contains(&value) {
            return Err(self.value(key, value.to_string(), "must be 1 to 200"));
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
        for j in 0..JOINTS {
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
