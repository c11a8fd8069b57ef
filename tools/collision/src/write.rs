//! Fits all groups of a plan, decides about all pairs, and writes the generated part of a robot file.

use crate::error::CollisionError;
use crate::fit::Shape;
use crate::mesh::Points;
use crate::plan::{Plan, SIDE};
use crate::prove::{Verdict, prove};
use crate::scene::Scene;
use crate::split::split;
use robot::{AllowedReason, Capsule, Model};
use std::fmt::Write;

/// Everything from this line on is written by this tool.
pub const MARK: &str = "# Below this line: written by `collision fit`.";
/// Coordinates are written to this many decimals, m: 10 um. Radii are rounded up.
const DECIMALS: usize = 5;

/// One capsule as the robot file has it.
#[derive(Clone, Debug)]
pub struct Named {
    /// Its name.
    pub name: String,
    /// The link in whose frame it is.
    pub link: String,
    /// Ends and radius, margin included.
    pub shape: Shape,
    /// Volume of the capsule without margin over the volume of the convex hull inside.
    pub volume_ratio: f64,
}

/// Fits every group.
pub fn fit_all(plan: &Plan, scene: &Scene<'_>) -> Result<Vec<Named>, CollisionError> {
    let mut capsules = Vec::new();
    for group in &plan.groups {
        let cells = split(scene.matter(group)?, group.capsules, &group.planes);
        let sides: &[&str] = if group.frame.contains(SIDE) {
            &["left", "right"]
        } else {
            &[""]
        };
        for side in sides {
            let mirror = if *side == "right" {
                Some(scene.mirror(&group.frame, "left", "right")?)
            } else {
                None
            };
            for (index, cell) in cells.iter().enumerate() {
                let stem = group.name.replace(SIDE, side);
                let name = if cells.len() == 1 {
                    stem
                } else {
                    format!("{stem}_{index}")
                };
                let place = |point| mirror.as_ref().map_or(point, |mirror| mirror(&point));
                let (a, b) = (rounded(place(cell.shape.a)), rounded(place(cell.shape.b)));
                // Rounding moves an end by half a unit per coordinate; the radius takes that up.
                let unit = 10_f64.powi(-(DECIMALS as i32));
                let radius_m = ((cell.shape.radius_m + plan.margin_mm * 1e-3 + unit) / unit).ceil() * unit;
                let shape = Shape { a, b, radius_m };
                let volume_ratio = ratio(&cell.matter.points(), &cell.shape);
                capsules.push(Named {
                    name,
                    link: group.frame.replace(SIDE, side),
                    shape,
                    volume_ratio,
                });
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

/// The hand-written part of a robot file.
pub fn head(text: &str) -> &str {
    text.find(MARK).map_or(text, |at| &text[..at])
}

/// The capsules' part of a robot file.
pub fn capsules_text(capsules: &[Named]) -> String {
    let mut text = String::new();
    let triple = |v: &nalgebra::Vector3<f64>| {
        let number = |x: f64| {
            if x == 0.0 {
                "0.0".to_owned()
            } else {
                format!("{x:.DECIMALS$}")
            }
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

/// Why a pair needs no check, if it needs none.
pub fn decide(model: &Model, a: &Capsule, b: &Capsule, clear_m: f64) -> Option<AllowedReason> {
    if a.body == b.body {
        return Some(AllowedReason::SameBody);
    }
    if model.parent_body(a.body) == Some(b.body) || model.parent_body(b.body) == Some(a.body) {
        return Some(AllowedReason::Adjacent);
    }
    matches!(prove(model, a, b, clear_m), Verdict::Clear { .. }).then_some(AllowedReason::ProvedClear)
}

/// The whole text of the robot file with these capsules, all pairs decided.
pub fn robot_file(
    plan: &Plan,
    capsules: &[Named],
    toml: (&str, &str),
    urdf: (&str, &str),
) -> Result<String, CollisionError> {
    let head = head(toml.1).trim_end();
    // Bodies and limits do not depend on capsules, but a model needs one: a stand-in of one capsule without pairs.
    let stand_in = capsules_text(&capsules[..1.min(capsules.len())]);
    let empty = "\n[collision.allowed.adjacent]\n\n[collision.allowed.proved_clear]\n";
    let skeleton = format!("{head}\n{stand_in}{empty}");
    let model = Model::from_text(toml.0, &skeleton, urdf.0, urdf.1)?;
    let mut bodies = Vec::with_capacity(capsules.len());
    for capsule in capsules {
        let link = model.link_body(&capsule.link);
        let (body, pose) = link.ok_or_else(|| {
            CollisionError::content(
                urdf.0,
                format!("capsule `{}`: no link `{}`", capsule.name, capsule.link),
            )
        })?;
        bodies.push(Capsule {
            name: capsule.name.clone(),
            body,
            a: pose.transform_point(&capsule.shape.a),
            b: pose.transform_point(&capsule.shape.b),
            radius_m: capsule.shape.radius_m,
        });
    }
    let mut text = format!("{head}\n\n{MARK}\n{}", capsules_text(capsules));
    let mut tables = [
        (AllowedReason::Adjacent, String::new()),
        (AllowedReason::ProvedClear, String::new()),
    ];
    for (first, a) in bodies.iter().enumerate() {
        let mut others: [Vec<String>; 2] = Default::default();
        for b in &bodies[first + 1..] {
            match decide(&model, a, b, plan.clear_mm * 1e-3) {
                Some(AllowedReason::Adjacent) => others[0].push(format!("\"{}\"", b.name)),
                Some(AllowedReason::ProvedClear) => others[1].push(format!("\"{}\"", b.name)),
                Some(AllowedReason::SameBody) | None => {}
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
        "\n# Proved to stay more than {} mm apart everywhere within the URDF's limits.\n[collision.allowed.proved_clear]\n{}",
        plan.clear_mm, tables[1].1
    );
    Ok(text)
}

/// Names in lines of at most 120 columns.
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
