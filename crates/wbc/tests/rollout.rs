//! Plays the stored plan of random ticks to rest in steps of a tenth of a millisecond. The judges share no
//! code with the certificate. They are parry's segments for the capsules, and the collision meshes
//! themselves.

use crate::support;

use messages::{JOINTS, Stamp};
use nalgebra::Vector3;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use robot::{AllowedReason, Frames, Hull, Model, Surface};
use std::path::Path;
use support::Subject;
use support::attack::Attacker;
use support::checker::{Checker, play};
use wbc::{Input, Options, Planned, State, Target, tick};

const STEP_S: f64 = 1e-4;
/// Rounding of positions along a plan that another formula plays, and of the other distance. It is 1e-9 m,
/// far below the micrometre that commands keep beyond d_min.
const ROUNDING_M: f64 = 1e-9;

fn model() -> Model {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/robots");
    let text = |name: &str| std::fs::read_to_string(folder.join(name)).expect("the shipped robot");
    let (toml, urdf) = (text("tiago_dual.toml"), text("tiago_dual.urdf"));
    let floor = robot::PlaneEntry { name: "floor".into(), normal: [0.0, 0.0, 1.0], offset_m: 0.0 };
    let environment = robot::Environment { planes: vec![floor], boxes: vec![] };
    Model::from_text("tiago_dual.toml", &toml, "tiago_dual.urdf", &urdf)
        .and_then(|model| model.with_environment("test", &environment))
        .expect("the shipped robot on a floor")
}

/// Returns plans of random ticks under attack.
fn plans(model: &Model, seed: u64, ticks: u64, count: usize) -> Vec<Planned> {
    let subject = Subject::of(model.clone());
    let config = subject.config(Options::default());
    let mut state = State::at_rest(&config, subject.home);
    let checker = Checker::new(&subject, state.planned());
    let mut attacker = Attacker::new(&subject, seed);
    let mut rng = Pcg64::seed_from_u64(seed);
    let mut plans = Vec::new();
    for k in 0..ticks {
        attacker.next(k, state.planned(), &checker);
        let target = Target { q: &attacker.q, dq: &attacker.dq, ddq: &[0.0; JOINTS], valid_mask: attacker.valid_mask };
        tick(&config, &mut state, Stamp::NONE, Input { k, target: Some(target), permit: attacker.permit });
        if rng.random_range(0..ticks) < count as u64 {
            plans.push(*state.planned());
        }
    }
    plans
}

/// Returns every posture of a plan from now to rest.
fn rollout(planned: &Planned) -> impl Iterator<Item = [f64; JOINTS]> + '_ {
    let end = (0..JOINTS).map(|j| planned.plan.duration_s[j].iter().sum()).fold(0.0, f64::max);
    let steps = (end / STEP_S).ceil() as u32 + 1;
    (0..=steps).map(|i| std::array::from_fn(|j| play(planned, j, f64::from(i) * STEP_S).0))
}

/// Least distance over the checked pairs by parry's segments, and of the moving capsules from the floor.
fn clearance(model: &Model, frames: &Frames, least_so_far: f64) -> f64 {
    let ends: Vec<[Vector3<f64>; 2]> =
        model.capsules.iter().map(|c| [c.a, c.b].map(|p| frames.base_from_body[c.body].transform_point(&p))).collect();
    let mut least = least_so_far;
    for pair in &model.pairs {
        let (a, b) = (&ends[pair.a], &ends[pair.b]);
        let (first, second) = (&model.capsules[pair.a], &model.capsules[pair.b]);
        let spheres = ((a[0] + a[1]) - (b[0] + b[1])).norm() - (a[0] - a[1]).norm() - (b[0] - b[1]).norm();
        let radii = first.radius_m + second.radius_m;
        if spheres / 2.0 - radii < least {
            least = least.min(robot::segment_distance_oracle(&a[0], &a[1], &b[0], &b[1]) - radii);
        }
    }
    for (ends, capsule) in ends.iter().zip(&model.capsules).filter(|(_, capsule)| capsule.body != 0) {
        least = least.min(ends[0].z.min(ends[1].z) - capsule.radius_m);
    }
    least
}

#[test]
fn plans_keep_clearance_until_rest() {
    let model = model();
    let mut frames = Frames::default();
    let (mut postures, mut least) = (0_u64, f64::INFINITY);
    for seed in 300..303 {
        for planned in plans(&model, seed, 6000, 40) {
            for q in rollout(&planned) {
                model.forward(&q, &mut frames);
                least = clearance(&model, &frames, least);
                postures += 1;
            }
        }
    }
    println!("{postures} postures, least clearance {:.6} mm", least * 1e3);
    assert!(postures > 50_000 && least >= model.d_min_m - ROUNDING_M, "{postures} postures, {least} m");
    assert!(least < model.d_min_m + 2e-3, "never close: {least} m");
}

/// The collision mesh of one link in the frame of its body, with a convex hull and a sphere that contain it.
struct Solid {
    link: String,
    body: usize,
    surface: Surface,
    hull: Hull,
    center: Vector3<f64>,
    radius_m: f64,
}

/// Returns the meshes of all links of the description in `folder`. None if it does not exist.
fn solids(model: &Model, folder: &Path) -> Option<Vec<Solid>> {
    let text = std::fs::read_to_string(folder.join("tiago_dual.urdf")).ok()?;
    let description = urdf_rs::read_from_string(&text).expect("a description");
    let mut solids = Vec::new();
    for link in &description.links {
        let Some((body, body_from_link)) = model.link_body(&link.name) else { continue };
        for collision in &link.collision {
            let urdf_rs::Geometry::Mesh { filename, scale } = &collision.geometry else { continue };
            let scale = scale.map_or(Vector3::repeat(1.0), |s| Vector3::from(s.0));
            let origin = robot::Pose::from_xyz_rpy(collision.origin.xyz.0, collision.origin.rpy.0);
            let (_, name) = filename.rsplit_once("/meshes/").expect("a mesh in its folder");
            let triangles = collision::mesh::read_mesh(&folder.join("meshes").join(name)).expect("a mesh");
            let place =
                |p: &Vector3<f64>| body_from_link.transform_point(&origin.transform_point(&p.component_mul(&scale)));
            let triangles: Vec<_> = triangles.iter().map(|corners| [0, 1, 2].map(|i| place(&corners[i]))).collect();
            let surface = Surface::new(&triangles).expect("a mesh with triangles");
            let hull = Hull::new(triangles.as_flattened()).expect("a mesh with a volume");
            let corners = hull.corners();
            let center = corners.iter().sum::<Vector3<f64>>() / corners.len() as f64;
            let radius_m = corners.iter().map(|p| (p - center).norm()).fold(0.0, f64::max);
            solids.push(Solid { link: link.name.clone(), body, surface, hull, center, radius_m });
        }
    }
    Some(solids)
}

/// Returns true if all capsules of two bodies are checked or proved clear. Bodies with one joint between them
/// may touch.
fn kept_apart(model: &Model, a: usize, b: usize) -> bool {
    a != b
        && !model.allowed.iter().any(|pair| {
            let bodies = [model.capsules[pair.a].body, model.capsules[pair.b].body];
            pair.reason == AllowedReason::Adjacent && (bodies == [a, b] || bodies == [b, a])
        })
}

#[test]
fn meshes_never_touch_on_plans_to_rest() {
    let model = model();
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/robots/tiago_dual");
    let Some(solids) = solids(&model, &folder) else {
        println!("skipped: no meshes in {}", folder.display());
        return;
    };
    let pairs: Vec<(&Solid, &Solid)> = (0..solids.len())
        .flat_map(|i| (0..i).map(move |k| (i, k)))
        .map(|(i, k)| (&solids[i], &solids[k]))
        .filter(|(a, b)| kept_apart(&model, a.body, b.body))
        .collect();
    let mut frames = Frames::default();
    let (mut postures, mut least, mut nearest) = (0_u64, f64::INFINITY, String::new());
    for planned in plans(&model, 310, 6000, 40) {
        for q in rollout(&planned).step_by(20) {
            model.forward(&q, &mut frames);
            postures += 1;
            for (a, b) in &pairs {
                let (pose_a, pose_b) = (&frames.base_from_body[a.body], &frames.base_from_body[b.body]);
                let between = pose_a.transform_point(&a.center) - pose_b.transform_point(&b.center);
                // The torso is hollow at the shoulders. An arm may be inside its hull and far from its
                // surface.
                let apart = between.norm() - a.radius_m - b.radius_m >= least
                    || a.hull.distance_m(pose_a, &b.hull, pose_b) >= least;
                if !apart {
                    let distance_m = a.surface.distance_m(pose_a, &b.surface, pose_b);
                    if distance_m < least {
                        (least, nearest) = (distance_m, format!("{} - {}", a.link, b.link));
                    }
                }
            }
        }
    }
    let millimetres = least * 1e3;
    println!("{postures} postures, {} pairs of meshes, least distance {millimetres:.2} mm, {nearest}", pairs.len());
    assert!(
        postures > 1000 && pairs.len() > 100 && least > 0.0,
        "{postures} postures, {} pairs, {least} m, {nearest}",
        pairs.len()
    );
}
