//! Fits all groups of a plan, decides about all pairs, and writes the generated part of a robot file.

use crate::content::Content;
use crate::error::CollisionError;
use crate::fit::Shape;
use crate::judge::Judge;
use crate::plan::{Group, Plan, SIDE};
use crate::prove::clearance;
use crate::scene::Scene;
use crate::split::{Cell, split};
use rayon::prelude::*;
use robot::{AllowedReason, Capsule, Frames, Model};
use rt::err;
use std::fmt::Write;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Everything from this line on is written by this tool.
pub const MARK: &str = "# Below this line: written by `collision fit`.";
/// Number of decimals of coordinates, m: 10 um. Radii are rounded up.
const DECIMALS: usize = 5;

#[derive(Clone, Debug)]
pub struct Named {
    pub name: String,
    pub link: String,
    /// Ends and radius, margin included.
    pub shape: Shape,
    /// Ratio of the volumes: the capsule without margin to the convex hull inside.
    pub volume_ratio: f64,
    /// Volume of the capsule without margin, m^3.
    pub volume_m3: f64,
    pub content: Arc<Content>,
}

pub fn fit_all(plan: &Plan, scene: &Scene<'_>) -> Result<Vec<Named>, CollisionError> {
    let fit = |group: &Group| {
        let cells = split(scene.matter(group)?, group.capsules, &group.cuts, group.slimness);
        named(plan, group, &cells, scene)
    };
    let groups: Vec<Vec<Named>> = plan.groups.par_iter().map(fit).collect::<Result<_, _>>()?;
    Ok(groups.into_iter().flatten().collect())
}

/// Returns the capsules of a group that was cut into these cells, on both sides if it has two.
pub fn named(plan: &Plan, group: &Group, cells: &[Cell], scene: &Scene<'_>) -> Result<Vec<Named>, CollisionError> {
    let mut capsules = Vec::new();
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
            let volume_ratio = cell.volume_ratio();
            let content = Arc::new(Content::new(cell.matter.map(|point| place(*point))));
            let (link, volume_m3) = (group.frame.replace(SIDE, side), cell.shape.volume_m3());
            capsules.push(Named { name, link, shape, volume_ratio, volume_m3, content });
        }
    }
    Ok(capsules)
}

fn rounded(point: nalgebra::Vector3<f64>) -> nalgebra::Vector3<f64> {
    let scale = 10_f64.powi(DECIMALS as i32);
    point.map(|x| (x * scale).round() / scale)
}

/// Returns the hand-written part of a robot file.
pub fn head(text: &str) -> &str {
    text.find(MARK).map_or(text, |at| &text[..at])
}

/// Returns a robot file's text in which a joint has this range under `[tighten]`.
pub fn tightened(text: &str, joint: &str, unit: &str, [low, high]: [f64; 2]) -> String {
    let hand = head(text);
    let bare = joint.chars().all(|c| c.is_ascii_alphanumeric() || "_-".contains(c));
    let header = if bare { format!("[tighten.{joint}]") } else { format!("[tighten.\"{joint}\"]") };
    let range = format!("{header}\nposition_min_{unit} = {low:?}\nposition_max_{unit} = {high:?}\n");
    let (before, own) = hand.split_once(&header).unwrap_or((hand, ""));
    let (own, after) = own.find("\n[").map_or((own, ""), |end| own.split_at(end));
    let kept = |line: &&str| !line.trim_start().starts_with("position_");
    let kept: String = own.lines().skip(1).filter(kept).map(|line| format!("{line}\n")).collect();
    format!("{}\n\n{range}{kept}{after}\n{}", before.trim_end(), &text[hand.len()..])
}

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

#[derive(Clone, Debug)]
pub struct Decided {
    pub text: String,
    /// Checked pairs that are closer than 5 cm at home, with their clearance, m.
    pub near_home: Vec<(String, String, f64)>,
}

/// Returns a model of the robot without its capsules. Bodies and limits do not depend on them, but a model needs
/// one. So it has one grain on this link, which no pair needs.
pub fn bare_model(link: &str, toml: (&str, &str), urdf: (&str, &str)) -> Result<Model, CollisionError> {
    let grain = format!(
        "name = \"grain\"\nlink = \"{link}\"\na_m = [0.0, 0.0, 0.0]\nb_m = [0.0, 0.0, 0.0]\nradius_m = 0.001\n"
    );
    let text = format!("{}\n\n[[collision.capsules]]\n{grain}", head(toml.1).trim_end());
    Ok(Model::from_text(toml.0, &text, urdf.0, urdf.1)?)
}

pub fn on_bodies(model: &Model, capsules: &[Named]) -> Result<Vec<Capsule>, CollisionError> {
    let place = |capsule: &Named| {
        let (body, pose) = model.link_body(&capsule.link).ok_or_else(|| {
            let cause = format!("capsule `{}`: no link `{}`", capsule.name, capsule.link);
            CollisionError::content(&model.texts.urdf_name, cause)
        })?;
        let (a, b) = (pose.transform_point(&capsule.shape.a), pose.transform_point(&capsule.shape.b));
        Ok(Capsule { name: capsule.name.clone(), body, a, b, radius_m: capsule.shape.radius_m })
    };
    capsules.iter().map(place).collect()
}

pub fn robot_file(
    plan: &Plan,
    capsules: &[Named],
    toml: (&str, &str),
    urdf: (&str, &str),
) -> Result<Decided, CollisionError> {
    let link = capsules.first().ok_or_else(|| CollisionError::content(urdf.0, "has no shapes"))?.link.as_str();
    let model = bare_model(link, toml, urdf)?;
    let bodies = on_bodies(&model, capsules)?;
    let mut frames = Frames::default();
    model.forward(&model.home, &mut frames);
    let judge = Judge::new(&model, plan, capsules);
    let pairs: Vec<(usize, usize)> =
        (0..capsules.len()).flat_map(|a| (a + 1..capsules.len()).map(move |b| (a, b))).collect();
    let done = AtomicUsize::new(0);
    let decide = |(a, b): &(usize, usize)| {
        let (reason, before) = (judge.decide(*a, *b), done.fetch_add(1, Ordering::Relaxed));
        let tenth = |done: usize| done * 10 / pairs.len();
        if tenth(before) < tenth(before + 1) {
            err!("proofs: {} of {} pairs", before + 1, pairs.len());
        }
        reason
    };
    let reasons: Vec<Option<AllowedReason>> = pairs.par_iter().map(decide).collect();
    let mut near_home = Vec::new();
    let mut tables: [String; 3] = Default::default();
    let mut decided = pairs.iter().zip(&reasons).peekable();
    for (first, a) in bodies.iter().enumerate() {
        let mut others: [Vec<String>; 3] = Default::default();
        while let Some((&(_, second), reason)) = decided.next_if(|((at, _), _)| *at == first) {
            let b = &bodies[second];
            match reason {
                Some(AllowedReason::Adjacent) => others[0].push(format!("\"{}\"", b.name)),
                Some(AllowedReason::ProvedClear) => others[1].push(format!("\"{}\"", b.name)),
                Some(AllowedReason::OverlapAsPublished) => others[2].push(format!("\"{}\"", b.name)),
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
            // Writing to a String cannot fail.
            let _ = writeln!(table, "{} = [\n{}]", a.name, wrapped(others));
        }
    }
    let [adjacent, clear, overlap] = &tables;
    let (mm, hull_mm, close_mm) = (plan.clear_mm, plan.clear_hull_mm, plan.clear_close_mm);
    let mut text = format!(
        "{}\n\n{MARK}\n{}\n# One joint apart: their stops keep them apart.\n[collision.allowed.adjacent]\n{adjacent}\n\
         # Proved to stay apart everywhere within the limits in force: the capsules by {mm} mm, or the convex hulls of what\n\
         # they contain by {hull_mm} mm. Inside one wrist or shoulder it is {close_mm} mm, by the hulls or by the surfaces.\n\
         [collision.allowed.proved_clear]\n{clear}",
        head(toml.1).trim_end(),
        capsules_text(capsules)
    );
    if !overlap.is_empty() {
        text.push_str(&format!(
            "\n# Proved to overlap in the maker's own description, in every posture within the limits in force. Nothing keeps these\n\
             # apart.\n[collision.allowed.overlap_as_published]\n{overlap}"
        ));
    }
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
