//! One robot: the tree of its moving bodies with masses, limits, friction and collision capsules.
//!
//! This is the second reader of the URDF and of the robot file. Joints that are not commanded stand where the file
//! holds them. A link behind them belongs to the body that carries it, and its mass is lumped there. Body 0 is the
//! base. Body `1 + j` moves with joint `j`, and its frame is the frame of that joint's child link.

use crate::error::PlantError;
use crate::pose::{Pose, turn};
use crate::robot_file::{RobotFile, Stricter};
use crate::urdf::{RawJoint, RawLimit, Urdf};
use messages::JOINTS_MAX;
use nalgebra::{Matrix3, Vector3};

/// The motion of a joint.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum JointKind {
    /// Turns about its axis, rad.
    Revolute,
    /// Slides along its axis, m.
    Prismatic,
}

/// Limits of one joint, rad or m.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// Least position.
    pub q_min: f64,
    /// Greatest position.
    pub q_max: f64,
    /// Greatest speed.
    pub v_max: f64,
    /// Greatest acceleration. Infinite in a URDF that names none.
    pub a_max: f64,
    /// Greatest jerk. Infinite in a URDF that names none.
    pub j_max: f64,
    /// Greatest torque or force, N m or N.
    pub effort_max: f64,
}

/// One commanded joint, and the place of its body on another.
#[derive(Clone, Debug, PartialEq)]
pub struct Joint {
    /// Name in the URDF.
    pub name: String,
    /// The motion of the joint.
    pub kind: JointKind,
    /// The body that carries it.
    pub parent: usize,
    /// Its body's frame in the parent body's frame at position zero.
    pub parent_from_body: Pose,
    /// Unit axis in its body's frame.
    pub axis: Vector3<f64>,
    /// Limits of the URDF: the mechanical stops, and the abilities of the motor.
    pub urdf: Limits,
    /// Limits in force: the stricter of the URDF and the robot file.
    pub limits: Limits,
    /// Number of the controller that moves it, in the robot file's order.
    pub controller: usize,
    /// Viscous friction as the URDF states it, N m s/rad or N s/m.
    pub damping: Option<f64>,
    /// Coulomb friction as the URDF states it, N m or N.
    pub friction: Option<f64>,
}

/// Mass, centre and inertia of one body, in the body's frame.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Inertia {
    /// Mass, kg.
    pub mass_kg: f64,
    /// First moment: mass times centre of mass, kg m.
    pub moment: Vector3<f64>,
    /// Inertia about the origin of the body's frame, kg m^2.
    pub about_origin: Matrix3<f64>,
}

/// All points within `radius_m` of a segment.
#[derive(Clone, Debug, PartialEq)]
pub struct Capsule {
    /// Unique name.
    pub name: String,
    /// The body that it is fixed to.
    pub body: usize,
    /// Ends of the segment in the body's frame, m.
    pub ends: [Vector3<f64>; 2],
    /// Radius, m.
    pub radius_m: f64,
}

#[derive(Clone, Debug)]
struct LinkPlace {
    name: String,
    body: usize,
    body_from_link: Pose,
}

/// One robot.
#[derive(Clone, Debug)]
pub struct Body {
    /// The commanded joints in the order of messages: body, left arm, right arm. A parent body never has a greater index than its child.
    pub joints: Vec<Joint>,
    /// Inertia of each body.
    pub inertias: [Inertia; JOINTS_MAX + 1],
    /// Collision capsules in the robot file's order.
    pub capsules: Vec<Capsule>,
    /// Indices of the capsules that must keep clear of each other, ascending.
    pub pairs: Vec<[usize; 2]>,
    /// Least clearance of every pair, m.
    pub d_min_m: f64,
    /// Home posture, rad or m.
    pub home: [f64; JOINTS_MAX],
    /// Payloads of the left and the right hand in the robot file: mass (kg), and place in the frame of the arm's
    /// last body (m). They are not in `inertias`.
    pub payloads: [Option<(f64, Vector3<f64>)>; 2],
    /// The last body of the left and of the right arm.
    pub hands: [usize; 2],
    links: Vec<LinkPlace>,
}

impl Inertia {
    /// Returns the inertia of a mass at a place, with its own inertia about that place.
    fn at(mass_kg: f64, place: Vector3<f64>, own: Matrix3<f64>) -> Self {
        // Parallel axes: I_o = I_c + m (c.c 1 - c c^T).
        let shift = Matrix3::identity() * place.norm_squared() - place * place.transpose();
        Self { mass_kg, moment: place * mass_kg, about_origin: own + shift * mass_kg }
    }

    pub(crate) fn add(&mut self, other: &Self) {
        self.mass_kg += other.mass_kg;
        self.moment += other.moment;
        self.about_origin += other.about_origin;
    }
}

impl Body {
    /// Reads a robot. Errors name the files.
    pub fn from_text(toml_name: &str, toml: &str, urdf_name: &str, urdf: &str) -> Result<Self, PlantError> {
        let file = RobotFile::read(toml_name, toml)?;
        let mut urdf = Urdf::read(urdf_name, urdf)?;
        for joint in &mut urdf.joints {
            file.supply(joint);
        }
        let names = order(&file, &urdf);
        if names.len() > JOINTS_MAX {
            let bound = format!("at most {JOINTS_MAX}");
            return Err(PlantError::value(toml_name, "number of commanded joints", names.len(), bound));
        }
        file.check_names(toml_name, &names)?;
        let tree = Tree { file: urdf_name, urdf: &urdf, at: find(urdf_name, &names, &urdf)? };
        let links = tree.links(toml_name, &file)?;
        let mut joints = Vec::with_capacity(JOINTS_MAX);
        let mut home = [0.0; JOINTS_MAX];
        for (j, name) in names.iter().enumerate() {
            let controller = file.controller(toml_name, name)?;
            joints.push(tree.joint(j, &links, &file.stricter(toml_name, name)?, controller)?);
            home[j] = file.home(toml_name, name)?;
        }
        let mut body = Self {
            joints,
            inertias: [Inertia::default(); JOINTS_MAX + 1],
            capsules: Vec::new(),
            pairs: Vec::new(),
            d_min_m: file.d_min_m(toml_name)?,
            home,
            payloads: file.payloads(toml_name)?.map(|row| row.map(|(mass_kg, at)| (mass_kg, at.into()))),
            // The joints of the right arm come last.
            hands: [names.len() - file.arms.right.joints.len(), names.len()],
            links,
        };
        body.lump(&urdf);
        body.read_capsules(toml_name, &file)?;
        body.read_pairs(toml_name, &file)?;
        Ok(body)
    }

    /// Returns the body that carries a link, and the link's pose in that body's frame.
    pub fn link(&self, name: &str) -> Option<(usize, Pose)> {
        self.links.iter().find(|known| known.name == name).map(|known| (known.body, known.body_from_link))
    }

    /// Adds a point mass at the origin of a link. Returns `false` if there is no such link.
    pub fn add_payload(&mut self, link: &str, mass_kg: f64) -> bool {
        let Some((body, body_from_link)) = self.link(link) else { return false };
        self.add_mass(body, body_from_link.t, mass_kg);
        true
    }

    /// Adds a point mass at a place (m) in the frame of a body.
    pub fn add_mass(&mut self, body: usize, place: Vector3<f64>, mass_kg: f64) {
        self.inertias[body].add(&Inertia::at(mass_kg, place, Matrix3::zeros()));
    }

    fn lump(&mut self, urdf: &Urdf) {
        for (raw, link) in urdf.links.iter().zip(&self.links) {
            let Some(inertial) = &raw.inertial else { continue };
            let frame = link.body_from_link.then(&inertial.origin);
            let [xx, xy, xz, yy, yz, zz] = inertial.inertia;
            let own = Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz);
            let turned = frame.r * own * frame.r.transpose();
            self.inertias[link.body].add(&Inertia::at(inertial.mass, frame.t, turned));
        }
    }

    fn read_capsules(&mut self, toml: &str, file: &RobotFile) -> Result<(), PlantError> {
        for row in &file.collision.capsules {
            let key = format!("collision.capsules `{}`", row.name);
            let known = self.links.iter().find(|link| link.name == row.link);
            let link = known.ok_or_else(|| PlantError::unknown(toml, key.as_str(), &row.link, "a link of the URDF"))?;
            if self.capsules.iter().any(|capsule| capsule.name == row.name) {
                return Err(PlantError::value(toml, &key, "twice", "names of capsules must be unique"));
            }
            let finite = row.a_m.iter().chain(&row.b_m).all(|x| x.is_finite());
            if !(row.radius_m > 0.0 && row.radius_m.is_finite() && finite) {
                return Err(PlantError::value(
                    toml,
                    &key,
                    row.radius_m,
                    "radius_m must be above 0, all numbers finite",
                ));
            }
            let ends = [row.a_m, row.b_m].map(|end| link.body_from_link.point(&end.into()));
            let (name, body, radius_m) = (row.name.clone(), link.body, row.radius_m);
            self.capsules.push(Capsule { name, body, ends, radius_m });
        }
        Ok(())
    }

    /// Reads the checked pairs. Every pair of capsules on two bodies is checked, unless the file allows it.
    fn read_pairs(&mut self, toml: &str, file: &RobotFile) -> Result<(), PlantError> {
        let count = self.capsules.len();
        let mut allowed = vec![false; count * count];
        let lists = &file.collision.allowed;
        let tables = [
            ("adjacent", &lists.adjacent),
            ("proved_clear", &lists.proved_clear),
            ("overlap_as_published", &lists.overlap_as_published),
        ];
        for (table, rows) in tables {
            let index = |name: &str| {
                let known = self.capsules.iter().position(|capsule| capsule.name == name);
                known.ok_or_else(|| PlantError::unknown(toml, format!("collision.allowed.{table}"), name, "a capsule"))
            };
            for (first, others) in rows {
                for second in others {
                    let (a, b) = (index(first)?, index(second)?);
                    allowed[a.min(b) * count + a.max(b)] = true;
                }
            }
        }
        for a in 0..count {
            for b in a + 1..count {
                if self.capsules[a].body != self.capsules[b].body && !allowed[a * count + b] {
                    self.pairs.push([a, b]);
                }
            }
        }
        Ok(())
    }
}

/// Returns the names of the commanded joints in the order of messages: the body's joints by their depth in the tree,
/// the left arm's, the right arm's.
fn order(file: &RobotFile, urdf: &Urdf) -> Vec<String> {
    let joint_above = |link: &str| urdf.joints.iter().find(|joint| joint.child == link);
    let depth = |name: &String| {
        let mut joint = urdf.joints.iter().find(|joint| joint.name == *name);
        let mut depth = 0;
        // A loop of links is refused later. Here it must only end.
        while let Some(above) = joint.filter(|_| depth <= urdf.joints.len()) {
            joint = joint_above(&above.parent);
            depth += 1;
        }
        depth
    };
    let mut names = file.body_joints.clone();
    names.sort_by_key(depth);
    names.extend(file.arms.left.joints.iter().chain(&file.arms.right.joints).cloned());
    names
}

/// Returns the places of the commanded joints in the URDF.
fn find(file: &str, names: &[String], urdf: &Urdf) -> Result<Vec<usize>, PlantError> {
    let mut at = Vec::with_capacity(names.len());
    for name in names {
        let known = urdf.joints.iter().position(|joint| joint.name == *name);
        let place = known.ok_or_else(|| PlantError::missing(file, format!("joint `{name}`")))?;
        if at.contains(&place) {
            return Err(PlantError::value(file, "joint", name, "is commanded twice; each joint may be named once"));
        }
        at.push(place);
    }
    Ok(at)
}

struct Tree<'a> {
    file: &'a str,
    urdf: &'a Urdf,
    at: Vec<usize>,
}

impl Tree<'_> {
    fn links(&self, toml: &str, file: &RobotFile) -> Result<Vec<LinkPlace>, PlantError> {
        let index = |name: &str, joint: &RawJoint| {
            let known = self.urdf.links.iter().position(|link| link.name == name);
            known.ok_or_else(|| {
                PlantError::unknown(self.file, format!("joint `{}`", joint.name), name, "a link of this file")
            })
        };
        // For each link: the joint above it, and the link above that.
        let mut above: Vec<Option<(usize, usize)>> = vec![None; self.urdf.links.len()];
        for (place, joint) in self.urdf.joints.iter().enumerate() {
            let (parent, child) = (index(&joint.parent, joint)?, index(&joint.child, joint)?);
            if above[child].replace((place, parent)).is_some() {
                return Err(PlantError::value(
                    self.file,
                    "child",
                    &joint.child,
                    "has two parents; the links must form a tree",
                ));
            }
            let moves = joint.kind != "fixed" && !self.at.contains(&place);
            if moves && !file.held_rad.contains_key(&joint.name) && !file.held_m.contains_key(&joint.name) {
                let key = format!("held_rad or held_m: movable joint `{}`", joint.name);
                return Err(PlantError::missing(toml, key));
            }
        }
        let roots: Vec<&str> = (0..above.len())
            .filter(|&link| above[link].is_none())
            .map(|link| self.urdf.links[link].name.as_str())
            .collect();
        if roots != [file.base_link.as_str()] {
            return Err(PlantError::value(
                toml,
                "base_link",
                &file.base_link,
                format!("must be the only root; roots: {roots:?}"),
            ));
        }
        (0..above.len()).map(|link| self.locate(link, &above, file)).collect()
    }

    /// Climbs from a link to the commanded joint above it.
    fn locate(
        &self,
        start: usize,
        above: &[Option<(usize, usize)>],
        file: &RobotFile,
    ) -> Result<LinkPlace, PlantError> {
        let name = self.urdf.links[start].name.clone();
        let (mut link, mut pose) = (start, Pose::identity());
        for _ in 0..=above.len() {
            let Some((place, parent)) = above[link] else {
                // The frame of the base is on the floor.
                pose.t.z += file.base_height_m;
                return Ok(LinkPlace { name, body: 0, body_from_link: pose });
            };
            if let Some(j) = self.at.iter().position(|commanded| *commanded == place) {
                return Ok(LinkPlace { name, body: j + 1, body_from_link: pose });
            }
            pose = self.held(&self.urdf.joints[place], file)?.then(&pose);
            link = parent;
        }
        Err(PlantError::value(self.file, "link", name, "is part of a loop; the links must form a tree"))
    }

    /// Returns the pose of a joint that is not commanded, where the file holds it.
    fn held(&self, joint: &RawJoint, file: &RobotFile) -> Result<Pose, PlantError> {
        let pose = joint.origin;
        if joint.kind == "fixed" {
            return Ok(pose);
        }
        if let Some(mimic) = &joint.mimic
            && self.at.iter().any(|&place| self.urdf.joints[place].name == *mimic)
        {
            let key = format!("joint `{}`: mimic", joint.name);
            return Err(PlantError::value(self.file, &key, mimic, "must not follow a commanded joint"));
        }
        let axis = self.unit_axis(joint)?;
        let table = if joint.kind == "prismatic" { &file.held_m } else { &file.held_rad };
        let position = table.get(&joint.name).copied().filter(|position| position.is_finite());
        let key = || format!("held position of `{}`, finite and in its unit", joint.name);
        let position = position.ok_or_else(|| PlantError::missing(self.file, key()))?;
        Ok(pose.then(&match joint.kind.as_str() {
            "prismatic" => Pose { r: Matrix3::identity(), t: axis * position },
            _ => Pose { r: turn(&axis, position), t: Vector3::zeros() },
        }))
    }

    /// Returns the direction of an axis of any length but zero.
    fn unit_axis(&self, joint: &RawJoint) -> Result<Vector3<f64>, PlantError> {
        Vector3::from(joint.axis).try_normalize(0.0).ok_or_else(|| {
            let key = format!("joint `{}`: axis", joint.name);
            PlantError::value(&self.place(joint), &key, format!("{:?}", joint.axis), "must not be zero")
        })
    }

    fn place(&self, joint: &RawJoint) -> String {
        format!("{}: line {}", self.file, joint.line)
    }

    fn joint(
        &self,
        j: usize,
        links: &[LinkPlace],
        stricter: &Stricter,
        controller: usize,
    ) -> Result<Joint, PlantError> {
        let raw = &self.urdf.joints[self.at[j]];
        let key = |what: &str| format!("joint `{}`: {what}", raw.name);
        let kind = match raw.kind.as_str() {
            "prismatic" => Some(JointKind::Prismatic),
            "revolute" => Some(JointKind::Revolute),
            _ => None,
        };
        let Some(kind) = kind.filter(|_| raw.mimic.is_none()) else {
            let bound = "a commanded joint must be revolute or prismatic, with limits and without mimic";
            return Err(PlantError::value(self.file, &key("type"), &raw.kind, bound));
        };
        let limit = raw.limit.ok_or_else(|| PlantError::missing(self.file, key("limit")))?;
        let carrier = links.iter().find(|link| link.name == raw.parent);
        let Some(carrier) = carrier.filter(|carrier| carrier.body <= j) else {
            let bound = "a joint must not be attached to a later one in the order body, left arm, right arm";
            return Err(PlantError::value(self.file, &key("parent"), &raw.parent, bound));
        };
        for (what, value) in [("damping", raw.damping), ("friction", raw.friction)] {
            if let Some(value) = value.filter(|value| *value < 0.0) {
                return Err(PlantError::value(self.file, &key(what), value, "must not be negative"));
            }
        }
        let (urdf, limits) = self.limits(&key("limit"), &limit, stricter)?;
        Ok(Joint {
            name: raw.name.clone(),
            kind,
            parent: carrier.body,
            parent_from_body: carrier.body_from_link.then(&raw.origin),
            axis: self.unit_axis(raw)?,
            urdf,
            limits,
            controller,
            damping: raw.damping,
            friction: raw.friction,
        })
    }

    /// Returns the URDF's limits, and the stricter of them and the robot file.
    fn limits(&self, key: &str, raw: &RawLimit, file: &Stricter) -> Result<(Limits, Limits), PlantError> {
        let urdf = Limits {
            q_min: raw.lower,
            q_max: raw.upper,
            v_max: raw.velocity,
            a_max: raw.acceleration,
            j_max: raw.jerk,
            effort_max: raw.effort,
        };
        let limits = Limits {
            q_min: (urdf.q_min + file.soft_margin).max(file.q_min),
            q_max: (urdf.q_max - file.soft_margin).min(file.q_max),
            v_max: urdf.v_max.min(file.v_max),
            a_max: urdf.a_max.min(file.a_max),
            j_max: urdf.j_max.min(file.j_max),
            effort_max: urdf.effort_max.min(file.effort_max),
        };
        let positive = [limits.v_max, limits.a_max, limits.j_max, limits.effort_max].iter().all(|x| *x > 0.0);
        if limits.q_min < limits.q_max && positive {
            return Ok((urdf, limits));
        }
        let value = format!("{limits:?}");
        Err(PlantError::value(
            self.file,
            key,
            value,
            "q_min must be below q_max, the others above 0; correct either file",
        ))
    }
}
