//! Reads the elements of a URDF: what urdfdom reads of them, with the place of every error.

use crate::error::RobotError;
use crate::pose::{quaternion, rpy_of};
use crate::xml::Element;
use urdf_rs::{Collision, Geometry, Joint, JointLimit, JointType, Link, LinkName, Material, Robot, Visual};

type Read<T> = Result<T, RobotError>;

/// A URDF, and the line of each of its links and joints.
pub(crate) struct Urdf {
    pub(crate) robot: Robot,
    pub(crate) link_lines: Vec<usize>,
    pub(crate) joint_lines: Vec<usize>,
}

/// Reads a URDF. What nothing uses may be wrong: materials, textures, and shapes to draw. An error names line and element,
/// and all errors are in one.
pub fn read_urdf(file: &str, text: &str) -> Result<Robot, RobotError> {
    Urdf::read(file, text).map(|urdf| urdf.robot)
}

impl Urdf {
    pub(crate) fn read(file: &str, text: &str) -> Read<Self> {
        let root = Element::parse(file, text)?;
        let place = |element| Place { file, element, owner: "" };
        if root.name != "robot" {
            return Err(place(&root).syntax("the first element must be <robot>".into()));
        }
        // An unexpanded xacro is not refused by its words alone: the file is refused if its links are no tree.
        let macros = root.children.iter().find(|child| child.name.starts_with("xacro:"));
        let mut errors = Vec::new();
        let mut links = Vec::new();
        let mut joints = Vec::new();
        for child in &root.children {
            match child.name.as_str() {
                "link" => links.extend(RobotError::keep(link(file, child), &mut errors).map(|link| (link, child.line))),
                "joint" => {
                    joints.extend(RobotError::keep(joint(file, child), &mut errors).map(|joint| (joint, child.line)));
                }
                _ => {}
            }
        }
        RobotError::all(errors)?;
        let ((links, link_lines), (mut joints, joint_lines)): ((Vec<_>, _), (Vec<_>, _)) =
            (links.into_iter().unzip(), joints.into_iter().unzip());
        let materials = root.all("material").map(material).collect();
        let name = root.attribute("name").unwrap_or_default().to_owned();
        let children: Vec<String> = joints.iter().map(|joint: &Joint| joint.child.link.clone()).collect();
        let roots = links.iter().filter(|link: &&Link| !children.contains(&link.name)).count();
        // A floating base stands where the file has it: nothing here moves it.
        let free = |joint: &Joint| joint.joint_type == JointType::Floating && !children.contains(&joint.parent.link);
        for joint in joints.iter_mut().filter(|joint| free(joint)) {
            joint.joint_type = JointType::Fixed;
        }
        if let Some(macros) = macros.filter(|_| roots != 1) {
            return Err(place(macros).syntax(XACRO.into()));
        }
        Ok(Self { robot: Robot { name, version: None, links, joints, materials }, link_lines, joint_lines })
    }
}

/// Why a text with macros is refused, and the way out.
const XACRO: &str = "xacro must be expanded first: `xacro FILE.xacro > FILE.urdf`";

/// An element, and the link or joint that it belongs to.
struct Place<'a> {
    file: &'a str,
    element: &'a Element,
    owner: &'a str,
}

impl<'a> Place<'a> {
    /// The child of a name. Two of them would be read differently by different programs.
    fn child(&self, name: &'a str) -> Read<Option<Place<'a>>> {
        let mut all = self.element.all(name);
        let first = all.next();
        if let Some(second) = all.next() {
            return Err(self.at(second).syntax("occurs twice, must be there once".into()));
        }
        Ok(first.map(|element| self.at(element)))
    }

    fn at(&self, element: &'a Element) -> Place<'a> {
        Place { element, ..*self }
    }

    fn needed(&self, name: &'a str) -> Read<Place<'a>> {
        self.child(name)?.ok_or_else(|| self.syntax(format!("has no <{name}>")))
    }

    fn syntax(&self, cause: String) -> RobotError {
        let owner = if self.owner.is_empty() { String::new() } else { format!("{}: ", self.owner) };
        let file = format!("{}: line {}", self.file, self.element.line);
        RobotError::Syntax { file, cause: format!("{owner}<{}>: {cause}", self.element.name) }
    }

    fn text(&self, key: &str) -> Read<&'a str> {
        self.element.attribute(key).ok_or_else(|| self.syntax(format!("has no `{key}`")))
    }

    fn numbers<const N: usize>(&self, key: &str, text: &str) -> Read<[f64; N]> {
        if text.contains("${") || text.contains("$(") {
            return Err(self.syntax(format!("{key} = \"{text}\": {XACRO}")));
        }
        let parsed: Option<Vec<f64>> = text.split_whitespace().map(|word| word.parse().ok()).collect();
        let parsed = parsed.and_then(|numbers| <[f64; N]>::try_from(numbers).ok());
        let wanted = if N == 1 { "a number".into() } else { format!("{N} numbers") };
        parsed.ok_or_else(|| self.syntax(format!("{key} = \"{text}\", must be {wanted}")))
    }

    fn vector<const N: usize>(&self, key: &str) -> Read<Option<[f64; N]>> {
        self.element.attribute(key).map(|text| self.numbers(key, text)).transpose()
    }

    fn number(&self, key: &str) -> Read<f64> {
        self.numbers(key, self.text(key)?).map(|[value]| value)
    }

    fn number_or(&self, key: &str, default: f64) -> Read<f64> {
        Ok(self.vector(key)?.map_or(default, |[value]| value))
    }

    /// `xyz` with `rpy`, or with `quat_xyzw` as in URDF 1.1.
    fn origin(&self) -> Read<urdf_rs::Pose> {
        let Some(origin) = self.child("origin")? else { return Ok(urdf_rs::Pose::default()) };
        let xyz = urdf_rs::Vec3(origin.vector("xyz")?.unwrap_or_default());
        let rpy = match (origin.vector("rpy")?, origin.vector("quat_xyzw")?) {
            (Some(_), Some(_)) => return Err(origin.syntax("has both rpy and quat_xyzw, must have one".into())),
            (rpy, None) => rpy.unwrap_or_default(),
            (None, Some(q)) => {
                let turn = quaternion(q).ok_or_else(|| origin.syntax("quat_xyzw must not be zero".into()))?;
                rpy_of(&turn)
            }
        };
        Ok(urdf_rs::Pose { xyz, rpy: urdf_rs::Vec3(rpy) })
    }
}

fn link(file: &str, element: &Element) -> Read<Link> {
    let name = Place { file, element, owner: "" }.text("name")?.to_owned();
    let place = Place { file, element, owner: &format!("link `{name}`") };
    let inertial = place.child("inertial")?.map(|one| inertial(&one)).transpose()?.unwrap_or_default();
    let collision = |child| {
        let shape = place.at(child);
        Ok(Collision { name: None, origin: shape.origin()?, geometry: geometry(&shape.needed("geometry")?)? })
    };
    let visual = |child| {
        let shape = place.at(child);
        let colour = shape.element.all("material").next().map(material);
        let geometry = geometry(&shape.needed("geometry")?)?;
        Ok::<_, RobotError>(Visual { name: None, origin: shape.origin()?, geometry, material: colour })
    };
    let collision = element.all("collision").map(collision).collect::<Read<_>>()?;
    // A shape that cannot be read is not drawn.
    let visual = element.all("visual").filter_map(|child| visual(child).ok()).collect();
    Ok(Link { name, inertial, visual, collision })
}

fn inertial(place: &Place<'_>) -> Read<urdf_rs::Inertial> {
    let (mass, inertia) = (place.needed("mass")?, place.needed("inertia")?);
    let [ixx, ixy, ixz, iyy, iyz, izz] = ["ixx", "ixy", "ixz", "iyy", "iyz", "izz"].map(|key| inertia.number(key));
    Ok(urdf_rs::Inertial {
        origin: place.origin()?,
        mass: urdf_rs::Mass { value: mass.number("value")? },
        inertia: urdf_rs::Inertia { ixx: ixx?, ixy: ixy?, ixz: ixz?, iyy: iyy?, iyz: iyz?, izz: izz? },
    })
}

fn geometry(place: &Place<'_>) -> Read<Geometry> {
    let element = place.element.children.first().ok_or_else(|| place.syntax("is empty".into()))?;
    let shape = place.at(element);
    let vector = |key| shape.numbers(key, shape.text(key)?).map(urdf_rs::Vec3);
    Ok(match element.name.as_str() {
        "box" => Geometry::Box { size: vector("size")? },
        "cylinder" => Geometry::Cylinder { radius: shape.number("radius")?, length: shape.number("length")? },
        "capsule" => Geometry::Capsule { radius: shape.number("radius")?, length: shape.number("length")? },
        "sphere" => Geometry::Sphere { radius: shape.number("radius")? },
        "mesh" => {
            let scale = shape.vector("scale")?.map(urdf_rs::Vec3);
            Geometry::Mesh { filename: shape.text("filename")?.to_owned(), scale }
        }
        _ => return Err(shape.syntax("is no shape: box, cylinder, capsule, sphere or mesh".into())),
    })
}

/// A colour or a texture that cannot be read is none.
fn material(element: &Element) -> Material {
    let place = Place { file: "", element, owner: "" };
    let rgba = |colour: &Element| place.at(colour).vector("rgba").ok().flatten();
    let color = element.all("color").find_map(rgba).map(|rgba| urdf_rs::Color { rgba: urdf_rs::Vec4(rgba) });
    Material { name: element.attribute("name").unwrap_or_default().to_owned(), color, texture: None }
}

fn joint(file: &str, element: &Element) -> Read<Joint> {
    let name = Place { file, element, owner: "" }.text("name")?.to_owned();
    let place = Place { file, element, owner: &format!("joint `{name}`") };
    let joint_type = match place.text("type")? {
        "revolute" => JointType::Revolute,
        "continuous" => JointType::Continuous,
        "prismatic" => JointType::Prismatic,
        "fixed" => JointType::Fixed,
        "floating" => JointType::Floating,
        "planar" => JointType::Planar,
        "spherical" => JointType::Spherical,
        other => return Err(place.syntax(format!("type = \"{other}\" is no type of a joint"))),
    };
    let end = |name| Ok(LinkName { link: place.needed(name)?.text("link")?.to_owned() });
    let mut axis = urdf_rs::Axis::default();
    if let Some(given) = place.child("axis")? {
        axis.xyz = urdf_rs::Vec3(given.numbers("xyz", given.text("xyz")?)?);
    }
    let limit = place.child("limit")?.map(|given| limit(&given)).transpose()?.unwrap_or_default();
    let mimic = |given: Place<'_>| {
        let (multiplier, offset) = (given.number_or("multiplier", 1.0)?, given.number_or("offset", 0.0)?);
        Ok(urdf_rs::Mimic {
            joint: given.text("joint")?.to_owned(),
            multiplier: Some(multiplier),
            offset: Some(offset),
        })
    };
    let dynamics = |given: Place<'_>| {
        Ok(urdf_rs::Dynamics { damping: given.number_or("damping", 0.0)?, friction: given.number_or("friction", 0.0)? })
    };
    Ok(Joint {
        joint_type,
        origin: place.origin()?,
        parent: end("parent")?,
        child: end("child")?,
        axis,
        limit,
        calibration: None,
        dynamics: place.child("dynamics")?.map(dynamics).transpose()?,
        mimic: place.child("mimic")?.map(mimic).transpose()?,
        safety_controller: None,
        name,
    })
}

/// A speed or an effort that is left out is zero. It is refused where the joint is commanded.
fn limit(place: &Place<'_>) -> Read<JointLimit> {
    Ok(JointLimit {
        lower: place.number_or("lower", 0.0)?,
        upper: place.number_or("upper", 0.0)?,
        effort: place.number_or("effort", 0.0)?,
        velocity: place.number_or("velocity", 0.0)?,
        acceleration: place.number_or("acceleration", f64::INFINITY)?,
        deceleration: place.number_or("deceleration", f64::INFINITY)?,
        jerk: place.number_or("jerk", f64::INFINITY)?,
    })
}
