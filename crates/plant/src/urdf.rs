//! Reads links and joints from URDF text as they are written. It interprets nothing but numbers.

use crate::error::PlantError;
use quick_xml::Reader;
use quick_xml::events::{BytesStart, Event};

/// Most links or joints. Assumption: a dual-arm robot with two five-fingered hands has 93.
const ELEMENTS_MAX: usize = 1000;

/// Mass, centre and inertia of a link, as written.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct RawInertial {
    pub(crate) xyz: [f64; 3],
    pub(crate) rpy: [f64; 3],
    pub(crate) mass: f64,
    /// ixx, ixy, ixz, iyy, iyz, izz.
    pub(crate) inertia: [f64; 6],
}

#[derive(Clone, Debug, PartialEq)]
pub(crate) struct RawLink {
    pub(crate) name: String,
    pub(crate) inertial: Option<RawInertial>,
}

/// `<limit>` as written. A value that the URDF leaves out is infinite.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct RawLimit {
    pub(crate) lower: f64,
    pub(crate) upper: f64,
    pub(crate) velocity: f64,
    pub(crate) effort: f64,
    pub(crate) acceleration: f64,
    pub(crate) jerk: f64,
}

#[derive(Clone, Debug, PartialEq)]
pub(crate) struct RawJoint {
    pub(crate) name: String,
    pub(crate) kind: String,
    pub(crate) parent: String,
    pub(crate) child: String,
    pub(crate) xyz: [f64; 3],
    pub(crate) rpy: [f64; 3],
    pub(crate) axis: [f64; 3],
    pub(crate) limit: Option<RawLimit>,
    /// `<dynamics damping>`, N m s/rad or N s/m.
    pub(crate) damping: Option<f64>,
    /// `<dynamics friction>`, N m or N.
    pub(crate) friction: Option<f64>,
    /// The joint that it mimics.
    pub(crate) mimic: Option<String>,
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
        let mut path: Vec<String> = Vec::new();
        let mut urdf = Self::default();
        loop {
            let at = reader.buffer_position();
            let event = reader.read_event().map_err(|error| syntax(format!("byte {at}: {error}")))?;
            match event {
                Event::Start(tag) => {
                    path.push(name_of(&tag));
                    urdf.element(&Tag { file, tag: &tag }, &path)?;
                }
                Event::Empty(tag) => {
                    path.push(name_of(&tag));
                    urdf.element(&Tag { file, tag: &tag }, &path)?;
                    path.pop();
                }
                Event::End(_) => {
                    path.pop();
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
        Ok(urdf)
    }

    fn element(&mut self, tag: &Tag<'_>, path: &[String]) -> Result<(), PlantError> {
        let steps: Vec<&str> = path.iter().map(String::as_str).collect();
        match steps.as_slice() {
            ["robot", "link"] => self.links.push(RawLink { name: tag.text("name")?, inertial: None }),
            ["robot", "joint"] => self.joints.push(RawJoint {
                name: tag.text("name")?,
                kind: tag.text("type")?,
                parent: String::new(),
                child: String::new(),
                xyz: [0.0; 3],
                rpy: [0.0; 3],
                // The URDF's default.
                axis: [1.0, 0.0, 0.0],
                limit: None,
                damping: None,
                friction: None,
                mimic: None,
            }),
            ["robot", "link", "inertial"] => {
                if let Some(link) = self.links.last_mut() {
                    link.inertial = Some(RawInertial::default());
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
            "origin" => (self.xyz, self.rpy) = tag.origin()?,
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
            "origin" => (self.xyz, self.rpy) = tag.origin()?,
            "axis" => self.axis = tag.triple("xyz", self.axis)?,
            "limit" => {
                let or_infinite = |key: &str| Ok(tag.optional(key)?.unwrap_or(f64::INFINITY));
                self.limit = Some(RawLimit {
                    lower: tag.optional("lower")?.unwrap_or(0.0),
                    upper: tag.optional("upper")?.unwrap_or(0.0),
                    velocity: tag.number("velocity")?,
                    effort: tag.number("effort")?,
                    acceleration: f64::min(or_infinite("acceleration")?, or_infinite("deceleration")?),
                    jerk: or_infinite("jerk")?,
                });
            }
            "dynamics" => (self.damping, self.friction) = (tag.optional("damping")?, tag.optional("friction")?),
            "mimic" => self.mimic = Some(tag.text("joint")?),
            _ => {}
        }
        Ok(())
    }
}

/// An opening tag, and the file that errors name.
struct Tag<'a> {
    file: &'a str,
    tag: &'a BytesStart<'a>,
}

impl Tag<'_> {
    fn key(&self, attribute: &str) -> String {
        format!("<{}> {attribute}", name_of(self.tag))
    }

    fn find(&self, attribute: &str) -> Result<Option<String>, PlantError> {
        let syntax = |cause: String| PlantError::Syntax {
            file: self.file.into(),
            cause: format!("{}: {cause}", self.key(attribute)),
        };
        let found = self.tag.try_get_attribute(attribute).map_err(|error| syntax(error.to_string()))?;
        found
            .map(|found| found.unescape_value().map(|text| text.into_owned()))
            .transpose()
            .map_err(|error| syntax(error.to_string()))
    }

    fn text(&self, attribute: &str) -> Result<String, PlantError> {
        self.find(attribute)?.ok_or_else(|| PlantError::missing(self.file, self.key(attribute)))
    }

    fn number(&self, attribute: &str) -> Result<f64, PlantError> {
        self.parse(attribute, &self.text(attribute)?)
    }

    fn optional(&self, attribute: &str) -> Result<Option<f64>, PlantError> {
        self.find(attribute)?.map(|text| self.parse(attribute, &text)).transpose()
    }

    fn triple(&self, attribute: &str, default: [f64; 3]) -> Result<[f64; 3], PlantError> {
        let Some(text) = self.find(attribute)? else { return Ok(default) };
        let numbers = text.split_whitespace().map(|word| self.parse(attribute, word));
        let numbers = numbers.collect::<Result<Vec<f64>, _>>()?;
        numbers.try_into().map_err(|_| {
            PlantError::value(self.file, &self.key(attribute), format!("\"{text}\""), "needs three numbers")
        })
    }

    fn origin(&self) -> Result<([f64; 3], [f64; 3]), PlantError> {
        Ok((self.triple("xyz", [0.0; 3])?, self.triple("rpy", [0.0; 3])?))
    }

    fn parse(&self, attribute: &str, text: &str) -> Result<f64, PlantError> {
        let number = text.trim().parse::<f64>().ok().filter(|number| number.is_finite());
        let refuse =
            || PlantError::value(self.file, &self.key(attribute), format!("\"{text}\""), "must be a finite number");
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
        assert_eq!((inertial.xyz, inertial.mass), ([1.0, 2.0, 3.0], 4.0));
    }

    #[test]
    fn malformed_urdf_is_refused_with_file_and_key() {
        let rows = [
            ("<link/>", "<link> name"),
            ("<link name=\"a\"><inertial><mass value=\"x\"/></inertial></link>", "<mass> value = \"x\""),
            ("<link name=\"a\"/><joint name=\"j\" type=\"fixed\"><origin xyz=\"1 2\"/></joint>", "needs three numbers"),
            ("<link name=\"a\">", "r.urdf"),
            ("&lol;<link name=\"a\"/>", "entity"),
        ];
        for (body, expected) in rows {
            let error = read(body).expect_err(body).to_string();
            assert!(error.contains("r.urdf") && error.contains(expected), "{body}: {error}");
        }
    }
}
