//! Judges the capsules of a robot file against the shapes of a URDF, link by link.

use crate::check::worst_point;
use crate::error::CollisionError;
use crate::first::Tree;
use crate::fit::Shape;
use crate::scene::{Posture, Scene, has_shapes};
use crate::split::Matter;
use nalgebra::Vector3;
use rayon::prelude::*;
use robot::{Hull, Model};
use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::Path;

/// One link that has shapes, and the capsules of the body that carries it.
#[derive(Clone, Debug)]
pub struct Covered {
    pub link: String,
    /// The link of the model in whose frame `at` is given: this one, or the nearest above.
    pub frame: String,
    /// Largest distance of a point of the link's shapes from all capsules of its body, m. It is negative inside, and
    /// infinite if the body has no capsule.
    pub out_m: f64,
    pub at: Vector3<f64>,
    pub capsules: usize,
    /// Volume of the body's capsules over the volume of the hulls of its links. Overlaps count twice. NaN if the hulls
    /// have no volume.
    pub volume_ratio: f64,
}

/// The judged links, the worst first, and what was not judged.
#[derive(Clone, Debug)]
pub struct Cover {
    pub links: Vec<Covered>,
    /// Joints that move capsules, but no shape of the URDF.
    pub unknown: Vec<String>,
    pub without: Vec<String>,
}

struct Part {
    body: usize,
    /// The hand's palm, or the link itself. Links of one hand have one hull.
    whole: String,
    /// Corners of its hull in all postures, in the body's frame.
    corners: Vec<Vector3<f64>>,
}

/// Judges every link of `urdf` that has shapes. A link that hangs from a hand is judged in all postures of its fingers.
/// Joints that nothing commands are held elsewhere. The links of `without` are left out.
pub fn cover(
    model: &Model,
    urdf: &urdf_rs::Robot,
    meshes: Option<&Path>,
    held: &Posture,
    without: &[String],
) -> Result<Cover, CollisionError> {
    let tree = Tree { model, urdf };
    let palms = tree.palms()?;
    let fingers = tree.fingers(&palms);
    let scene = Scene::new(urdf, meshes, &fingers).holding(held.clone()).with_round_spheres();
    if let Some(link) = without.iter().find(|name| !urdf.links.iter().any(|link| &link.name == *name)) {
        return Err(CollisionError::content(&urdf.name, format!("has no link `{link}` to leave out")));
    }
    let of_robot = |link: &&urdf_rs::Link| has_shapes(link) && !without.contains(&link.name);
    let shaped: Vec<_> = urdf.links.iter().filter(of_robot).collect();
    if shaped.is_empty() {
        let cause = "no link has a shape; give the manufacturer's URDF with --urdf";
        return Err(CollisionError::content(&urdf.name, cause));
    }
    let judged = |link: &&urdf_rs::Link| judge(&tree, &scene, &palms, &link.name);
    let (mut links, parts): (Vec<Covered>, Vec<Part>) =
        shaped.par_iter().map(judged).collect::<Result<Vec<_>, _>>()?.into_iter().unzip();
    let hulls_m3 = hulls_m3(&parts);
    for (covered, part) in links.iter_mut().zip(&parts) {
        let own = model.capsules.iter().filter(|capsule| capsule.body == part.body);
        let capsules_m3: f64 = own.map(|c| Shape { a: c.a, b: c.b, radius_m: c.radius_m }.volume_m3()).sum();
        covered.volume_ratio = capsules_m3 / hulls_m3.get(&part.body).copied().unwrap_or(f64::NAN);
    }
    links.sort_by(|a, b| b.out_m.total_cmp(&a.out_m));
    let mut unknown: Vec<usize> = model.capsules.iter().map(|capsule| capsule.body).collect();
    unknown.retain(|body| *body > 0 && !parts.iter().any(|part| part.body == *body));
    unknown.sort_unstable();
    unknown.dedup();
    let unknown = unknown.into_iter().map(|body| model.joint_names[body - 1].clone()).collect();
    Ok(Cover { links, unknown, without: without.to_vec() })
}

fn judge(tree: &Tree<'_>, scene: &Scene<'_>, palms: &[String], link: &str) -> Result<(Covered, Part), CollisionError> {
    let frame = tree.known(link)?;
    let palm = tree.lineage(link).into_iter().find(|above| palms.iter().any(|palm| palm == above));
    let (shapes, poses) = scene.swept(frame, palm.unwrap_or(link), link)?;
    let placed = poses
        .iter()
        .flat_map(|pose| shapes.iter().map(|points| points.iter().map(|point| pose.transform_point(point)).collect()));
    let matter = Matter { surface: placed.collect(), pieces: Vec::new() };
    let wrong = || CollisionError::content(&tree.urdf.name, format!("the robot has no link `{frame}`"));
    let (body, body_from_frame) = tree.model.link_body(frame).ok_or_else(wrong)?;
    let capsules = crate::check::capsules_in_frame(tree.model, frame, |_| true);
    let (out_m, at) = worst_point(&matter, &capsules).unwrap_or((f64::NEG_INFINITY, Vector3::zeros()));
    let own: Vec<Vector3<f64>> = shapes.iter().flatten().copied().collect();
    let corners = Hull::new(&own).map_or(own, |hull| hull.corners());
    let poses = poses.iter().map(|pose| body_from_frame.compose(pose));
    let corners =
        poses.flat_map(|pose| corners.iter().map(move |point| pose.transform_point(point)).collect::<Vec<_>>());
    let part = Part { body, whole: palm.unwrap_or(link).to_owned(), corners: corners.collect() };
    let (link, frame) = (link.to_owned(), frame.to_owned());
    Ok((Covered { link, frame, out_m, at, capsules: capsules.len(), volume_ratio: f64::NAN }, part))
}

/// Returns the volume of all hulls of each body, m^3.
fn hulls_m3(parts: &[Part]) -> BTreeMap<usize, f64> {
    let mut wholes: BTreeMap<(usize, &str), Vec<Vector3<f64>>> = BTreeMap::new();
    for part in parts {
        wholes.entry((part.body, &part.whole)).or_default().extend(&part.corners);
    }
    let mut bodies = BTreeMap::new();
    for ((body, _), corners) in &wholes {
        *bodies.entry(*body).or_insert(0.0) += robot::hull_volume_oracle(corners).unwrap_or(0.0);
    }
    bodies
}

impl Cover {
    pub fn holds(&self) -> bool {
        self.links.iter().all(|link| link.out_m <= 0.0)
    }

    pub fn page(&self) -> String {
        let wide = self.links.iter().map(|link| link.link.len()).max().unwrap_or(0).max(4);
        let mut text = self.verdict();
        // Writing to a String cannot fail.
        let _ = writeln!(
            text,
            "\n{:wide$} {:>13} {:>25} {:>8} {:>12}",
            "link", "sticks out mm", "at x, y, z, m", "capsules", "volume ratio"
        );
        for Covered { link, out_m, at, capsules, volume_ratio, .. } in &self.links {
            let at = format!("{:.3}, {:.3}, {:.3}", at.x, at.y, at.z);
            let out_mm = out_m * 1e3;
            let _ = writeln!(text, "{link:wide$} {out_mm:+13.2} {at:>25} {capsules:8} {volume_ratio:12.2}");
        }
        text.push_str(
            "Sticks out: the worst point of the link's shapes, from the nearest capsule of the body that carries the link.\n\
             A negative value lies inside. The place is in the frame of the link, or of the nearest link above that the robot\n\
             file's URDF has. Capsules and volume ratio are those of the whole body: its capsules over the convex hulls of its\n\
             links. A large ratio costs freedom of motion, not safety.\n",
        );
        if !self.unknown.is_empty() {
            let names = self.unknown.join(", ");
            let _ = writeln!(text, "Not judged, because the URDF has no shape on what these joints move: {names}.");
        }
        if !self.without.is_empty() {
            let _ = writeln!(text, "Left out, as you asked: {}.", self.without.join(", "));
        }
        text
    }

    fn verdict(&self) -> String {
        let count = self.links.len();
        let out = self.links.iter().filter(|link| !(link.out_m <= 0.0)).count();
        let Some(Covered { link, frame, out_m, at, capsules, .. }) = self.links.first().filter(|_| out > 0) else {
            let least_mm = self.links.first().map_or(0.0, |link| -link.out_m * 1e3);
            return format!(
                "covered: the shapes of all {count} links lie in their capsules, at least {least_mm:.2} mm below the surface\n"
            );
        };
        let worst = if *capsules == 0 {
            format!("`{link}` moves with a body that has no capsule.")
        } else {
            let (out_mm, [x, y, z]) = (out_m * 1e3, [at.x, at.y, at.z]);
            format!("`{link}` sticks out by {out_mm:.2} mm at ({x:.3}, {y:.3}, {z:.3}) m in the frame of `{frame}`.")
        };
        format!(
            "NOT COVERED: {out} of {count} links stick out of their capsules. {worst}\n\
             No collision check sees what sticks out. Fit again with `collision fit`, or widen the capsules.\n"
        )
    }
}
