//! Reads links and joints from URDF text as they are written. It interprets nothing but numbers.

use crate::error::PlantError;
use crate::pose::Pose;
use quick_xml::Reader;
use quick_xml::events::{BytesStart, Event};

/// Most links or joints. Assumption: a dual-arm robot with two five-fingered hands has 93.
const ELEMENTS_MAX: usize = 1000;

/// Elements that a joint, a link or an inertial may have once.
const ONCE: [&str; 9] = ["inertial", "mass", "inertia", "origin", "parent", "child", "axis", "limit", "mimic"];

/// Mass, centre and inertia of a link, as written.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct RawInertial {
    pub(crate) origin: Pose,
    pub(crate) mass: f64,
    /// ixx, ixy, ixz, iyy, iyz, izz.
    pub(crate) inertia: [f64; 6],
}

#[derive(Clone, Debug, PartialEq)]
pub(crate) struct RawLink {
    pub(crate) name: String,
    pub(crate) inertial: Option<RawInertial>,
}

/// `<limit>` as written. An acceleration or a jerk that the URDF leaves out is infinite. The others are zero.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct RawLimit {
    pub(crate) lower: f64,
    pub(crate) upper: f64,
    pub(crate) velocity: f64,
    pub(crate) effort: f64,
    pub(crate) acceleration: f64,
    pub(crate) jerk: f64,
}

impl Default for RawLimit {
    fn default() -> Self {
        let (acceleration, jerk) = (f64::INFINITY, f64::INFINITY);
        Self { lower: 0.0, upper: 0.0, velocity: 0.0, effort: 0.0, acceleration, jerk }
    }
}

#[derive(Clone, Debug, PartialEq)]
pub(crate) struct RawJoint {
    pub(crate) name: String,
    pub(crate) kind: String,
    pub(crate) parent: String,
    pub(crate) child: String,
    pub(crate) origin: Pose,
    pub(crate) axis: [f64; 3],
    pub(crate) limit: Option<RawLimit>,
    /// `<dynamics damping>`, N m s/rad or N s/m.
    pub(crate) damping: Option<f64>,
    /// `<dynamics friction>`, N m or N.
    pub(crate) friction: Option<f64>,
    /// The joint that it mimics.
    pub(crate) mimic: Option<String>,
    /// Its line in the text.
    pub(crate) line: usize,
}

/// All links and joints in the order of the text.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Urdf {
    pub(crate) links: Vec<RawLink>,
    pub(crate) joints: Vec<RawJoint>,
}

impl Urdf {
    /// Reads a text. `file` is named in errors.
    pub(crate) fn read(file: &str, text: &str) -> Result<Self, PlantError> {
        let syntax = |cause: String| PlantError::Syntax { file: file.into(), cause };
        let mut reader = Reader::from_str(text);
        // The open elements, and those that each of them has had.
        let mut path: Vec<String> = Vec::new();
        let mut parts: Vec<Vec<String>> = vec![Vec::new()];
        let mut urdf = Self::default();
        let (mut line, mut counted) = (1, 0);
        loop {
            let at = reader.buffer_position() as usize;
            line += text.as_bytes()[counted..at.min(text.len())].iter().filter(|byte| **byte == b'\n').count();
            counted = at.min(text.len());
            let event = reader.read_event().map_err(|error| syntax(format!("byte {at}: {error}")))?;
            match event {
                Event::Start(tag) => {
                    path.push(name_of(&tag));
                    urdf.element(&Tag { file, tag: &tag, line }, &path, &mut parts)?;
                    parts.push(Vec::new());
                }
                Event::Empty(tag) => {
                    path.push(name_of(&tag));
                    urdf.element(&Tag { file, tag: &tag, line }, &path, &mut parts)?;
                    path.pop();
                }
                Event::End(_) => {
                    path.pop();
                    parts.pop();
                }
                Event::DocType(_) | Event::GeneralRef(_) => {
                    return Err(syntax(format!("byte {at}: a document type or an entity; write the text out instead")));
                }
                Event::Eof if path.is_empty() => break,
                Event::Eof => return Err(syntax(format!("ends inside `{}`; close it", path.join("/")))),
                Event::Text(_) | Event::CData(_) | Event::Comment(_) | Event::Decl(_) | Event::PI(_) => {}
            }
            if urdf.links.len().max(urdf.joints.len()) > ELEMENTS_MAX {
                return Err(PlantError::value(file, "links or joints", ">", format!("at most {ELEMENTS_MAX}")));
            }
        }
        if urdf.links.is_empty() {
            return Err(PlantError::missing(file, "robot/link"));
        }
        // A base that floats is where the file has it.
        let below: Vec<String> = urdf.joints.iter().map(|joint| joint.child.clone()).collect();
        for joint in &mut urdf.joints {
            if joint.kind == "floating" && !below.contains(&joint.parent) {
                joint.kind = "fixed".into();
            }
        }
        Ok(urdf)
    }

    fn element(&mut self, tag: &Tag<'_>, path: &[String], parts: &mut [Vec<String>]) -> Result<(), PlantError> {
        let steps: Vec<&str> = path.iter().map(String::as_str).collect();
        if let (["robot", "joint", part] | ["robot", "link", "inertial", part] | ["robot", "link", part], [.., had]) =
            (steps.as_slice(), parts)
            && ONCE.contains(part)
        {
            if had.iter().any(|other| other == part) {
                let bound = "must be there once; other programs read another one";
                return Err(PlantError::value(&tag.place(), &format!("<{part}>"), "twice", bound));
            }
            had.push((*part).to_owned());
        }
        match steps.as_slice() {
            ["robot", "link"] => self.links.push(RawLink { name: tag.text("name")?, inertial: None }),
            ["robot", "joint"] => self.joints.push(RawJoint {
                name: tag.text("name")?,
                kind: tag.text("type")?,
                line: tag.line,
                parent: String::new(),
                child: String::new(),
                origin: Pose::identity(),
                // The URDF's default.
                axis: [1.0, 0.0, 0.0],
                limit: None,
                damping: None,
                friction: None,
                mimic: None,
            }),
            ["robot", "link", "inertial"] => {
                if let Some(link) = self.links.last_mut() {
                    link.inertial = Some(RawInertial { origin: Pose::identity(), mass: 0.0, inertia: [0.0; 6] });
                }
            }
            ["robot", "link", "inertial", part] => {
                if let Some(inertial) = self.links.last_mut().and_then(|link| link.inertial.as_mut()) {
                    inertial.part(tag, part)?;
                }
            }
            ["robot", "joint", part] => {
                if let Some(joint) = self.joints.last_mut() {
                    joint.part(tag, part)?;
                }
            }
            _ => {}
        }
        Ok(())
    }
}

impl RawInertial {
    fn part(&mut self, tag: &Tag<'_>, part: &str) -> Result<(), PlantError> {
        match part {
            "origin" => self.origin = tag.origin()?,
            "mass" => self.mass = tag.number("value")?,
            "inertia" => {
                for (value, key) in self.inertia.iter_mut().zip(["ixx", "ixy", "ixz", "iyy", "iyz", "izz"]) {
                    *value = tag.number(key)?;
                }
            }
            _ => {}
        }
        Ok(())
    }
}

impl RawJoint {
    fn part(&mut self, tag: &Tag<'_>, part: &str) -> Result<(), PlantError> {
        match part {
            "parent" => self.parent = tag.text("link")?,
            "child" => self.child = tag.text("link")?,
            "origin" => self.origin = tag.origin()?,
            "axis" => {
                self.axis = tag.numbers("xyz")?.ok_or_else(|| PlantError::missing(&tag.place(), tag.key("xyz")))?
            }
            "limit" => {
                let or_infinite = |key: &str| Ok(tag.optional(key)?.unwrap_or(f64::INFINITY));
                self.limit = Some(RawLimit {
                    lower: tag.optional("lower")?.unwrap_or(0.0),
                    upper: tag.optional("upper")?.unwrap_or(0.0),
                    velocity: tag.optional("velocity")?.unwrap_or(0.0),
                    effort: tag.optional("effort")?.unwrap_or(0.0),
                    acceleration: f64::min(or_infinite("acceleration")?, or_infinite("deceleration")?),
                    jerk: or_infinite("jerk")?,
                });
            }
            "dynamics" => (self.damping, self.friction) = (tag.optional("damping")?, tag.optional("friction")?),
            "mimic" => {
                self.mimic = Some(tag.text("joint")?);
                // Where a follower stands is the robot file's matter. The numbers must be some.
                let _ = (tag.optional("multiplier")?, tag.optional("offset")?);
            }
            _ => {}
        }
        Ok(())
    }
}

/// An opening tag with its line, and the file that errors name.
struct Tag<'a> {
    file: &'a str,
    tag: &'a BytesStart<'a>,
    line: usize,
}

impl Tag<'_> {
    fn place(&self) -> String {
        format!("{}: line {}", self.file, self.line)
    }

    fn key(&self, attribute: &str) -> String {
        format!("<{}> {attribute}", name_of(self.tag))
    }

    fn find(&self, attribute: &str) -> Result<Option<String>, PlantError> {
        let syntax = |cause: String| PlantError::Syntax {
            file: self.place(),
            cause: format!("{}: {cause}", self.key(attribute)),
        };
        let found = self.tag.try_get_attribute(attribute).map_err(|error| syntax(error.to_string()))?;
        found
            .map(|found| found.unescape_value().map(|text| text.into_owned()))
            .transpose()
            .map_err(|error| syntax(error.to_string()))
    }

    fn text(&self, attribute: &str) -> Result<String, PlantError> {
        self.find(attribute)?.ok_or_else(|| PlantError::missing(&self.place(), self.key(attribute)))
    }

    fn number(&self, attribute: &str) -> Result<f64, PlantError> {
        self.parse(attribute, &self.text(attribute)?)
    }

    fn optional(&self, attribute: &str) -> Result<Option<f64>, PlantError> {
        self.find(attribute)?.map(|text| self.parse(attribute, &text)).transpose()
    }

    fn numbers<const N: usize>(&self, attribute: &str) -> Result<Option<[f64; N]>, PlantError> {
        let Some(text) = self.find(attribute)? else { return Ok(None) };
        let numbers = text.split_whitespace().map(|word| self.parse(attribute, word));
        let numbers = numbers.collect::<Result<Vec<f64>, _>>()?;
        let refuse = |_| {
            PlantError::value(&self.place(), &self.key(attribute), format!("\"{text}\""), format!("needs {N} numbers"))
        };
        numbers.try_into().map(Some).map_err(refuse)
    }

    /// The pose of an origin: a place, and angles or a quaternion of any length.
    fn origin(&self) -> Result<Pose, PlantError> {
        let xyz = self.numbers("xyz")?.unwrap_or_default();
        match (self.numbers("rpy")?, self.numbers::<4>("quat_xyzw")?) {
            (rpy, None) => Ok(Pose::from_origin(xyz, rpy.unwrap_or_default())),
            (None, Some(q)) if q.iter().any(|x| *x != 0.0) => Ok(Pose::from_quaternion(xyz, q)),
            (_, Some(q)) => {
                let bound = "must not be zero, and no rpy may stand beside it";
                Err(PlantError::value(&self.place(), &self.key("quat_xyzw"), format!("{q:?}"), bound))
            }
        }
    }

    fn parse(&self, attribute: &str, text: &str) -> Result<f64, PlantError> {
        let number = text.trim().parse::<f64>().ok().filter(|number| number.is_finite());
        let refuse =
            || PlantError::value(&self.place(), &self.key(attribute), format!("\"{text}\""), "must be a finite number");
        number.ok_or_else(refuse)
    }
}

fn name_of(tag: &BytesStart<'_>) -> String {
    String::from_utf8_lossy(tag.name().as_ref()).into_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(body: &str) -> Result<Urdf, PlantError> {
        Urdf::read("r.urdf", &format!("<robot name=\"r\">{body}</robot>"))
    }

    #[test]
    fn nested_elements_of_other_parents_are_not_joints() {
        let urdf = read(
            "<link name=\"a\"><visual><origin xyz=\"9 9 9\"/></visual>
             <inertial><origin xyz=\"1 2 3\"/><mass value=\"4\"/></inertial></link>
             <transmission name=\"t\"><joint name=\"a_joint\"><limit/></joint></transmission>",
        )
        .unwrap();
        assert!(urdf.joints.is_empty());
        let inertial = urdf.links[0].inertial.unwrap();
        assert_eq!((inertial.origin.t, inertial.mass), ([1.0, 2.0, 3.0].into(), 4.0));
    }
}
