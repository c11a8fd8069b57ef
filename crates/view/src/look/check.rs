//! Reads a look from a look file's text and checks every value.

use super::file::{ClosingEntry, FORMAT, LookFile, MeshEntry, MirrorEntry, PartEntry, ShapeName};
use super::{Closing, Colour, FingerMotion, Look, LookError, NamedMesh, Part, Shape, rows};
use robot::{Model, Pose};
use std::collections::BTreeMap;
use std::ops::RangeInclusive;

/// Range of sizes, m: from a tenth of a millimetre to more than the size of a robot with two arms.
const SIZE_M: RangeInclusive<f64> = 1e-4..=5.0;
/// Range of positions in a link's frame, m.
const PLACE_M: RangeInclusive<f64> = -10.0..=10.0;
/// Range of angles, rad: one turn each way.
const TURN_RAD: RangeInclusive<f64> = -6.3..=6.3;
/// Range of mesh scales: the file's unit may be from micrometres to kilometres.
const SCALE: RangeInclusive<f64> = 1e-6..=1e3;
/// Range of the exponents of an outline. 2 is round.
const SQUARENESS: RangeInclusive<f64> = 2.0..=16.0;
/// Largest number of parts, meshes and profile points. A browser draws them all 60 times a second.
const PARTS_MAX: usize = 512;
const PROFILE_MAX: usize = 64;
/// Largest number of names of one mesh: files for drawing and for collisions, of several versions.
const NAMES_MAX: usize = 8;
/// Largest number of motions of a finger's part: the joints of a finger.
const MOTIONS_MAX: usize = 4;
/// Default roughness: painted plastic. Assumption.
const ROUGHNESS: f64 = 0.55;

pub struct Checker<'a> {
    file: &'a str,
    model: &'a Model,
    colours: BTreeMap<String, Colour>,
}

impl<'a> Checker<'a> {
    pub fn new(file: &'a str, model: &'a Model) -> Self {
        Self { file, model, colours: BTreeMap::new() }
    }

    pub fn look(mut self, text: &str) -> Result<Look, LookError> {
        let read: LookFile = toml::from_str(text)
            .map_err(|error| LookError::Syntax { file: self.file.into(), cause: error.to_string() })?;
        if read.format != FORMAT {
            return Err(self.value("format", read.format, FORMAT));
        }
        for (name, text) in &read.colours {
            let colour = self.colour(&format!("colours.{name}"), text)?;
            self.colours.insert(name.clone(), colour);
        }
        let mut look = Look::default();
        for (link, colour) in &read.links {
            self.link("links", link)?;
            look.links.push((link.clone(), self.colour(&format!("links.{link}"), colour)?));
        }
        look.capsules = self.link_colours(&look);
        for (name, colour) in &read.capsules {
            let expected = "a capsule of the robot file";
            let at = self.model.capsules.iter().position(|capsule| capsule.name == *name);
            let at = at.ok_or_else(|| self.unknown("capsules", name, expected))?;
            look.capsules[at] = Some(self.colour(&format!("capsules.{name}"), colour)?);
        }
        for (key, count) in [("parts", read.parts.len()), ("meshes.files", read.meshes.files.len())] {
            if count > PARTS_MAX {
                return Err(self.value(&format!("number of {key}"), count, format!("at most {PARTS_MAX}")));
            }
        }
        for (n, entry) in read.parts.iter().enumerate() {
            self.part(&format!("parts[{n}]"), entry, &mut look.parts)?;
        }
        for (n, entry) in read.meshes.files.iter().enumerate() {
            let mesh = self.mesh(&format!("meshes.files[{n}]"), entry, &look)?;
            look.meshes.push(mesh);
        }
        Ok(look)
    }

    /// Returns the colour of each capsule's link. Only the robot file says which link that is.
    fn link_colours(&self, look: &Look) -> Vec<Option<Colour>> {
        let robot: Option<toml::Table> = self.model.texts.toml.parse().ok();
        let entries = robot.as_ref().and_then(|robot| robot.get("collision")?.get("capsules")?.as_array());
        let colour = |name: &str| {
            let entry = entries?.iter().find(|entry| entry.get("name").and_then(toml::Value::as_str) == Some(name))?;
            look.colour_of(entry.get("link")?.as_str()?)
        };
        self.model.capsules.iter().map(|capsule| colour(&capsule.name)).collect()
    }

    fn part(&self, key: &str, entry: &PartEntry, parts: &mut Vec<Part>) -> Result<(), LookError> {
        let (body, body_from_link) = self.link(&format!("{key}.link"), &entry.link)?;
        let key = format!("{key} ({})", entry.link);
        let part = Part {
            link: entry.link.clone(),
            body,
            body_from_shape: [[0.0; 4]; 3],
            closing: None,
            shape: self.shape(&key, entry)?,
            colour: self.colour(&format!("{key}.colour"), &entry.colour)?,
            roughness: self.within(&format!("{key}.roughness"), entry.roughness.unwrap_or(ROUGHNESS), &(0.0..=1.0))?,
        };
        let link_from_shape = self.pose(&key, entry.xyz_m, entry.rpy_rad)?;
        let motions = self.motions(&key, &entry.closing)?;
        let placed = |link: &str, body, body_from_link: &Pose, scale| {
            let body_from_shape = rows(body_from_link, scale, &link_from_shape);
            let closing = self.closing(&key, body, &motions)?.map(|hand| Closing {
                hand,
                body_from_link: rows(body_from_link, scale, &Pose::identity()),
                link_from_shape: rows(&link_from_shape, [1.0; 3], &Pose::identity()),
                motions: motions.clone(),
            });
            Ok(Part { link: link.to_owned(), body, body_from_shape, closing, ..part.clone() })
        };
        parts.push(placed(&entry.link, body, &body_from_link, [1.0; 3])?);
        if let Some(mirror) = &entry.mirror {
            let (body, body_from_link) = self.link(&format!("{key}.mirror.link"), &mirror.link)?;
            parts.push(placed(&mirror.link, body, &body_from_link, self.signs(&key, mirror)?)?);
        }
        Ok(())
    }

    /// Reads the motions of a part that closes with its hand.
    fn motions(&self, key: &str, entries: &[ClosingEntry]) -> Result<Vec<FingerMotion>, LookError> {
        let key = format!("{key}.closing");
        if entries.len() > MOTIONS_MAX {
            return Err(self.value(&key, format!("{} motions", entries.len()), format!("at most {MOTIONS_MAX}")));
        }
        let read = |entry: &ClosingEntry| match *entry {
            ClosingEntry { slide_m: Some(offset_m), pivot_m: None, axis: None, turn_rad: None } => {
                Ok(FingerMotion::Slide { offset_m: self.all_within(&key, offset_m, &PLACE_M)? })
            }
            ClosingEntry { slide_m: None, pivot_m: Some(pivot_m), axis: Some(axis), turn_rad: Some(turn_rad) } => {
                let pivot_m = self.all_within(&key, pivot_m, &PLACE_M)?;
                let turn_rad = self.within(&key, turn_rad, &TURN_RAD)?;
                let length = axis.iter().map(|x| x * x).sum::<f64>().sqrt();
                self.within(&format!("{key}: length of the axis"), length, &(0.001..=1e3))?;
                Ok(FingerMotion::Turn { pivot_m, axis: axis.map(|x| x / length), turn_rad })
            }
            _ => Err(self.value(&key, "incomplete", "slide_m alone, or pivot_m, axis and turn_rad")),
        };
        entries.iter().map(read).collect()
    }

    /// Returns the hand that moves a part of `body`. `None` for a part without motions.
    fn closing(&self, key: &str, body: usize, motions: &[FingerMotion]) -> Result<Option<usize>, LookError> {
        if motions.is_empty() {
            return Ok(None);
        }
        let hand = self.model.arms.iter().position(|arm| arm.hand_body() == body);
        hand.map(Some)
            .ok_or_else(|| self.value(&format!("{key}.closing"), "given", "left out of a link that is no hand"))
    }

    fn signs(&self, key: &str, mirror: &MirrorEntry) -> Result<[f64; 3], LookError> {
        if mirror.axes.chars().any(|axis| !"xyz".contains(axis)) {
            return Err(self.value(&format!("{key}.mirror.axes"), &mirror.axes, "letters of `xyz`"));
        }
        Ok(['x', 'y', 'z'].map(|axis| if mirror.axes.contains(axis) { -1.0 } else { 1.0 }))
    }

    fn shape(&self, key: &str, entry: &PartEntry) -> Result<Shape, LookError> {
        self.only_what_belongs(key, entry)?;
        let size = |name: &str, value: Option<f64>| {
            let value = value.ok_or_else(|| self.missing(key, name))?;
            self.within(&format!("{key}.{name}"), value, &SIZE_M)
        };
        let edge = || self.within(&format!("{key}.edge_m"), entry.edge_m.unwrap_or(0.0), &(0.0..=*SIZE_M.end()));
        let three = |name: &str, value: Option<[f64; 3]>, bound: &RangeInclusive<f64>| {
            let value = value.ok_or_else(|| self.missing(key, name))?;
            self.all_within(&format!("{key}.{name}"), value, bound)
        };
        Ok(match entry.shape {
            ShapeName::Box => Shape::Box { size_m: three("size_m", entry.size_m, &SIZE_M)?, edge_m: edge()? },
            ShapeName::Cylinder | ShapeName::Cone => {
                let radius_m = size("radius_m", entry.radius_m)?;
                let is_cone = entry.shape == ShapeName::Cone;
                let top_radius_m = if is_cone { size("top_radius_m", entry.top_radius_m)? } else { radius_m };
                let length_m = size("length_m", entry.length_m)?;
                Shape::Cone { radius_m, top_radius_m, length_m, edge_m: edge()? }
            }
            ShapeName::Sphere => Shape::Ellipsoid { radii_m: [size("radius_m", entry.radius_m)?; 3] },
            ShapeName::Ellipsoid => Shape::Ellipsoid { radii_m: three("radii_m", entry.radii_m, &SIZE_M)? },
            ShapeName::Capsule => {
                let radius_m = size("radius_m", entry.radius_m)?;
                let top_radius_m =
                    if entry.top_radius_m.is_some() { size("top_radius_m", entry.top_radius_m)? } else { radius_m };
                let (a_m, b_m) = (three("a_m", entry.a_m, &PLACE_M)?, three("b_m", entry.b_m, &PLACE_M)?);
                Shape::Capsule { a_m, b_m, radius_m, top_radius_m }
            }
            ShapeName::Lathe => self.lathe(key, entry)?,
        })
    }

    fn lathe(&self, key: &str, entry: &PartEntry) -> Result<Shape, LookError> {
        let profile_m = entry.profile_m.clone().ok_or_else(|| self.missing(key, "profile_m"))?;
        let key = |name: &str| format!("{key}.{name}");
        if !(2..=PROFILE_MAX).contains(&profile_m.len()) {
            let bound = format!("2 to {PROFILE_MAX} points");
            return Err(self.value(&key("profile_m"), format!("{} points", profile_m.len()), bound));
        }
        for [radius_m, height_m] in &profile_m {
            self.within(&key("profile_m: radius"), *radius_m, &(0.0..=*SIZE_M.end()))?;
            self.within(&key("profile_m: height"), *height_m, &PLACE_M)?;
        }
        let stretch = self.all_within(&key("stretch"), entry.stretch.unwrap_or([1.0; 2]), &(0.01..=10.0))?;
        let squareness = self.within(&key("squareness"), entry.squareness.unwrap_or(2.0), &SQUARENESS)?;
        Ok(Shape::Lathe { profile_m, stretch, squareness })
    }

    /// Rejects sizes that the shape does not have. They would be ignored silently.
    fn only_what_belongs(&self, key: &str, entry: &PartEntry) -> Result<(), LookError> {
        let belongs: &[&str] = match entry.shape {
            ShapeName::Box => &["size_m", "edge_m"],
            ShapeName::Cylinder => &["radius_m", "length_m", "edge_m"],
            ShapeName::Cone => &["radius_m", "top_radius_m", "length_m", "edge_m"],
            ShapeName::Sphere => &["radius_m"],
            ShapeName::Ellipsoid => &["radii_m"],
            ShapeName::Capsule => &["a_m", "b_m", "radius_m", "top_radius_m"],
            ShapeName::Lathe => &["profile_m", "stretch", "squareness"],
        };
        let given = [
            ("size_m", entry.size_m.is_some()),
            ("edge_m", entry.edge_m.is_some()),
            ("radius_m", entry.radius_m.is_some()),
            ("top_radius_m", entry.top_radius_m.is_some()),
            ("length_m", entry.length_m.is_some()),
            ("radii_m", entry.radii_m.is_some()),
            ("a_m", entry.a_m.is_some()),
            ("b_m", entry.b_m.is_some()),
            ("profile_m", entry.profile_m.is_some()),
            ("stretch", entry.stretch.is_some()),
            ("squareness", entry.squareness.is_some()),
        ];
        match given.iter().find(|(name, is_given)| *is_given && !belongs.contains(name)) {
            Some((name, _)) => {
                let expected = format!("left out, because this shape has {}", belongs.join(", "));
                Err(self.value(&format!("{key}.{name}"), "given", expected))
            }
            None => Ok(()),
        }
    }

    fn mesh(&self, key: &str, entry: &MeshEntry, look: &Look) -> Result<NamedMesh, LookError> {
        let (body, body_from_link) = self.link(&format!("{key}.link"), &entry.link)?;
        let key = format!("{key} ({})", entry.link);
        if entry.names.is_empty() || entry.names.len() > NAMES_MAX {
            return Err(self.value(&format!("{key}.names"), entry.names.len(), format!("1 to {NAMES_MAX} names")));
        }
        let scale = entry.scale.unwrap_or([1.0; 3]);
        self.all_within(&format!("{key}.scale"), scale.map(f64::abs), &SCALE)?;
        let link_from_mesh = self.pose(&key, entry.xyz_m, entry.rpy_rad)?;
        let body_from_mesh = rows(&body_from_link.compose(&link_from_mesh), scale, &Pose::identity());
        let (link, files) = (entry.link.clone(), entry.names.clone());
        Ok(NamedMesh { colour: look.colour_of(&link), link, body, body_from_mesh, files })
    }

    fn pose(&self, key: &str, xyz_m: Option<[f64; 3]>, rpy_rad: Option<[f64; 3]>) -> Result<Pose, LookError> {
        let xyz_m = self.all_within(&format!("{key}.xyz_m"), xyz_m.unwrap_or_default(), &PLACE_M)?;
        let rpy_rad = self.all_within(&format!("{key}.rpy_rad"), rpy_rad.unwrap_or_default(), &TURN_RAD)?;
        Ok(Pose::from_xyz_rpy(xyz_m, rpy_rad))
    }

    fn link(&self, key: &str, name: &str) -> Result<(usize, Pose), LookError> {
        let found = self.model.links().find(|(link, ..)| *link == name);
        let (_, body, pose) = found.ok_or_else(|| self.unknown(key, name, "a link of the URDF"))?;
        Ok((body, *pose))
    }

    /// Reads a colour: a name of `[colours]`, or `#rrggbb`.
    fn colour(&self, key: &str, text: &str) -> Result<Colour, LookError> {
        if let Some(colour) = self.colours.get(text) {
            return Ok(*colour);
        }
        let digits = text.strip_prefix('#').filter(|digits| digits.len() == 6 && digits.is_ascii());
        let channel = |n: usize| u8::from_str_radix(digits?.get(2 * n..2 * n + 2)?, 16).ok();
        match (channel(0), channel(1), channel(2)) {
            (Some(r), Some(g), Some(b)) if !text.contains('+') => Ok(Colour([r, g, b])),
            _ => Err(self.unknown(key, text, "#rrggbb or a name in [colours]")),
        }
    }

    fn within(&self, key: &str, value: f64, bound: &RangeInclusive<f64>) -> Result<f64, LookError> {
        // NaN is in no range.
        if bound.contains(&value) {
            return Ok(value);
        }
        Err(self.value(key, value, format!("{} to {}", bound.start(), bound.end())))
    }

    fn all_within<const N: usize>(
        &self,
        key: &str,
        values: [f64; N],
        bound: &RangeInclusive<f64>,
    ) -> Result<[f64; N], LookError> {
        values.iter().try_for_each(|&value| self.within(key, value, bound).map(drop))?;
        Ok(values)
    }

    fn missing(&self, key: &str, name: &str) -> LookError {
        self.value(&format!("{key}.{name}"), "missing", "given for this shape")
    }

    fn value(&self, key: &str, value: impl ToString, bound: impl ToString) -> LookError {
        LookError::Value { file: self.file.into(), key: key.into(), value: value.to_string(), bound: bound.to_string() }
    }

    fn unknown(&self, key: &str, name: &str, expected: &str) -> LookError {
        LookError::Unknown { file: self.file.into(), key: key.into(), name: name.into(), expected: expected.into() }
    }
}
