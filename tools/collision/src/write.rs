//! Fits all groups of a plan, decides about all pairs, and writes the generated part of a robot file.

use crate::error::CollisionError;
use crate::fit::Shape;
use crate::mesh::Points;
use crate::plan::{Plan, SIDE};
use crate::prove::{Part, Verdict, clearance, deciding_joints, prove, prove_parts};
use crate::scene::Scene;
use crate::split::{Matter, split};
use robot::{AllowedReason, Capsule, Frames, Hull, Model};
use std::collections::HashMap;
use std::fmt::Write;

/// Everything from this line on is written by this tool.
pub const MARK: &str = "# Below this line: written by `collision fit`.";
/// Number of decimals of coordinates, m: 10 um. Radii are rounded up.
const DECIMALS: usize = 5;

/// One capsule as it is in the robot file.
#[derive(Clone, Debug)]
pub struct Named {
    /// Its name.
    pub name: String,
    /// The link whose frame is used.
    pub link: String,
    /// Ends and radius, margin included.
    pub shape: Shape,
    /// Ratio of the volumes: the capsule without margin to the convex hull inside.
    pub volume_ratio: f64,
    /// Volume of the capsule without margin, m^3.
    pub volume_m3: f64,
    /// Contents, in the frame of the link.
    pub matter: Matter,
}

/// Fits every group.
pub fn fit_all(plan: &Plan, scene: &Scene<'_>) -> Result<Vec<Named>, CollisionError> {
    let mut capsules = Vec::new();
    for group in &plan.groups {
        let cells = split(scene.matter(group)?, group.capsules, &group.cuts, group.slimness);
        let sides: &[&str] = if group.frame.contains(SIDE) { &["left", "right"] } else { &[""] };
        for side in sides {
            let mirror = if *side == "right" { Some(scene.mirror(&group.frame, "left", "right")?) } else { None };
            for (index, cell) in cells.iter().enumerate() {
                let stem = group.name.replace(SIDE, side);
                let name = if cells.len() == 1 { stem } else { format!("{stem}_{index}") };
                let place = |point| mirror.as_ref().map_or(point, |mirror| mirror(&point));
                let (a, b) = (rounded(place(cell.shape.a)), rounded(place(cell.shape.b)));
                // Rounding moves an end by half a unit per coordinate. The radius compensates for this.
                let unit = 10_f64.powi(-(DECIMALS as i32));
                let radius_m = ((cell.shape.radius_m + plan.margin_mm * 1e-3 + unit) / unit).ceil() * unit;
                let shape = Shape { a, b, radius_m };
                let volume_ratio = ratio(&cell.matter.points(), &cell.shape);
                let matter = cell.matter.map(|point| place(*point));
                let (link, volume_m3) = (group.frame.replace(SIDE, side), cell.shape.volume_m3());
                capsules.push(Named { name, link, shape, volume_ratio, volume_m3, matter });
            }
        }
    }
    Ok(capsules)
}

fn rounded(point: nalgebra::Vector3<f64>) -> nalgebra::Vector3<f64> {
    let scale = 10_f64.powi(DECIMALS as i32);
    point.map(|x| (x * scale).round() / scale)
}

fn ratio(points: &Points, shape: &Shape) -> f64 {
    robot::hull_volume_oracle(points).map_or(f64::NAN, |volume| shape.volume_m3() / volume)
}

/// Returns the hand-written part of a robot file.
pub fn head(text: &str) -> &str {
    text.find(MARK).map_or(text, |at| &text[..at])
}

/// Returns the capsules' part of a robot file.
pub fn capsules_text(capsules: &[Named]) -> String {
    let mut text = String::new();
    let triple = |v: &nalgebra::Vector3<f64>| {
        let number = |x: f64| {
            if x == 0.0 { "0.0".to_owned() } else { format!("{x:.DECIMALS$}") }
        };
        format!("[{}, {}, {}]", number(v.x), number(v.y), number(v.z))
    };
    for capsule in capsules {
        let shape = &capsule.shape;
        // Writing to a String cannot fail.
        let _ = writeln!(
            text,
            "\n[[collision.capsules]]\nname = \"{}\"\nlink = \"{}\"\na_m = {}\nb_m = {}\nradius_m = {:.DECIMALS$}",
            capsule.name,
            capsule.link,
            triple(&shape.a),
            triple(&shape.b),
            shape.radius_m
        );
    }
    text
}

/// Decides about pairs, and caches convex hulls.
pub struct Judge<'a> {
    model: &'a Model,
    plan: &'a Plan,
    capsules: &'a [Named],
    hulls: HashMap<usize, Option<Hull>>,
}

/// Largest number of deciding joints for which a proof by hulls is tried: parts of one shoulder or wrist, or a
/// neck.
const HULL_JOINTS_MAX: usize = 3;

impl<'a> Judge<'a> {
    /// Creates a judge of these capsules on this robot.
    pub fn new(model: &'a Model, plan: &'a Plan, capsules: &'a [Named]) -> Self {
        Self { model, plan, capsules, hulls: HashMap::new() }
    }

    /// Returns a shape of capsule `index` as a capsule on its body.
    fn on_body(&self, index: usize, shape: &Shape) -> Option<Capsule> {
        let named = &self.capsules[index];
        let (body, pose) = self.model.link_body(&named.link)?;
        let (a, b) = (pose.transform_point(&shape.a), pose.transform_point(&shape.b));
        Some(Capsule { name: named.name.clone(), body, a, b, radius_m: shape.radius_m })
    }

    /// Returns the convex hull, in the body's frame, of a capsule's contents.
    fn hull(&mut self, index: usize) -> Option<Hull> {
        if !self.hulls.contains_key(&index) {
            let named = &self.capsules[index];
            let hull = self.model.link_body(&named.link).and_then(|(_, pose)| {
                let points: Vec<_> = named.matter.points().iter().map(|point| pose.transform_point(point)).collect();
                Hull::new(&points)
            });
            self.hulls.insert(index, hull);
        }
        self.hulls[&index].clone()
    }

    /// Proves that two capsules' contents stay apart, by the capsules or by the convex hulls of their contents.
    /// Returns the bound, m, and true if the hulls were needed.
    pub fn prove(&mut self, first: usize, second: usize) -> Option<(f64, bool)> {
        let a = self.on_body(first, &self.capsules[first].shape)?;
        let b = self.on_body(second, &self.capsules[second].shape)?;
        if let Verdict::Clear { at_least_m } = prove(self.model, &a, &b, self.plan.clear_mm * 1e-3) {
            return Some((at_least_m, false));
        }
        let (of_a, of_b) = deciding_joints(self.model, a.body, b.body);
        if of_a.len() + of_b.len() > HULL_JOINTS_MAX {
            return None;
        }
        let (hull_a, hull_b) = (self.hull(first)?, self.hull(second)?);
        let (corners_a, corners_b) = (hull_a.corners(), hull_b.corners());
        let bound_m = self.plan.hull_bound_mm(&a.name, &b.name) * 1e-3;
        let distance = |frames: &Frames| {
            let pose = |body: usize| &frames.base_from_body[body];
            hull_a.distance_m(pose(a.body), &hull_b, pose(b.body))
        };
        let (part_a, part_b) = (Part { body: a.body, points: &corners_a }, Part { body: b.body, points: &corners_b });
        match prove_parts(self.model, &part_a, &part_b, bound_m, &distance) {
            Verdict::Clear { at_least_m } => Some((at_least_m, true)),
            Verdict::Meets { .. } | Verdict::Open => None,
        }
    }

    /// Returns the reason why a pair needs no check. None if it needs one.
    pub fn decide(&mut self, first: usize, second: usize) -> Option<AllowedReason> {
        let body = |index: usize| self.model.link_body(&self.capsules[index].link).map(|(body, _)| body);
        let (a, b) = (body(first)?, body(second)?);
        if a == b {
            return Some(AllowedReason::SameBody);
        }
        if self.model.parent_body(a) == Some(b) || self.model.parent_body(b) == Some(a) {
            return Some(AllowedReason::Adjacent);
        }
        self.prove(first, second).map(|_| AllowedReason::ProvedClear)
    }
}

/// A robot file with all pairs decided.
#[derive(Clone, Debug)]
pub struct Decided {
    /// Whole text of the file.
    pub text: String,
    /// Checked pairs that are closer than 5 cm at home, with their clearance, m.
    pub near_home: Vec<(String, String, f64)>,
}

/// Returns the whole text of the robot file with these capsules, with all pairs decided.
pub fn robot_file(
    plan: &Plan,
    capsules: &[Named],
    toml: (&str, &str),
    urdf: (&str, &str),
) -> Result<Decided, CollisionError> {
    let mut frames = Frames::default();
    let mut near_home = Vec::new();
    let head = head(toml.1).trim_end();
    // Bodies and limits do not depend on capsules, but a model needs one. So a placeholder with one capsule and
    // no pairs is used.
    let stand_in = capsules_text(&capsules[..1.min(capsules.len())]);
    let empty = "\n[collision.allowed.adjacent]\n\n[collision.allowed.proved_clear]\n";
    let skeleton = format!("{head}\n{stand_in}{empty}");
    let model = Model::from_text(toml.0, &skeleton, urdf.0, urdf.1)?;
    model.forward(&model.home, &mut frames);
    let mut bodies = Vec::with_capacity(capsules.len());
    for capsule in capsules {
        let link = model.link_body(&capsule.link);
        let (body, pose) = link.ok_or_else(|| {
            CollisionError::content(urdf.0, format!("capsule `{}`: no link `{}`", capsule.name, capsule.link))
        })?;
        bodies.push(Capsule {
            name: capsule.name.clone(),
            body,
            a: pose.transform_point(&capsule.shape.a),
            b: pose.transform_point(&capsule.shape.b),
            radius_m: capsule.shape.radius_m,
        });
    }
    let mut judge = Judge::new(&model, plan, capsules);
    let mut text = format!("{head}\n\n{MARK}\n{}", capsules_text(capsules));
    let mut tables = [(AllowedReason::Adjacent, String::new()), (AllowedReason::ProvedClear, String::new())];
    for (first, a) in bodies.iter().enumerate() {
        let mut others: [Vec<String>; 2] = Default::default();
        for (second, b) in bodies.iter().enumerate().skip(first + 1) {
            match judge.decide(first, second) {
                Some(AllowedReason::Adjacent) => others[0].push(format!("\"{}\"", b.name)),
                Some(AllowedReason::ProvedClear) => others[1].push(format!("\"{}\"", b.name)),
                Some(AllowedReason::SameBody) => {}
                None => {
                    let clearance_m = clearance(&frames, a, b);
                    if clearance_m < 0.05 {
                        near_home.push((a.name.clone(), b.name.clone(), clearance_m));
                    }
                }
            }
        }
        for (table, others) in tables.iter_mut().zip(&others).filter(|(_, others)| !others.is_empty()) {
            let _ = writeln!(table.1, "{} = [\n{}]", a.name, wrapped(others));
        }
    }
    let _ = write!(
        text,
        "\n# One joint apart: their stops keep them apart.\n[collision.allowed.adjacent]\n{}",
        tables[0].1
    );
    let _ = write!(
        text,
        "\n# Proved to stay apart everywhere within the limits in force: the capsules by {} mm, or the convex hulls of what\n\
         # they contain by {} mm ({} mm inside one wrist or shoulder).\n[collision.allowed.proved_clear]\n{}",
        plan.clear_mm, plan.clear_hull_mm, plan.clear_close_mm, tables[1].1
    );
    Ok(Decided { text, near_home })
}

/// Formats names in lines of at most 120 columns.
fn wrapped(names: &[String]) -> String {
    let mut text = String::new();
    let mut line = String::from("   ");
    for name in names {
        if line.len() + name.len() + 2 > 120 {
            text.push_str(&line);
            text.push('\n');
            line = String::from("   ");
        }
        let _ = write!(line, " {name},");
    }
    text + &line + "\n"
}
