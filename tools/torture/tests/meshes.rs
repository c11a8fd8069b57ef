//! Checks what the capsules represent. Convex hulls of the manufacturer's collision meshes stay apart while the
//! robot is attacked. The test places them with its own kinematics. It runs only if the meshes are present.

use collision::mesh::read_mesh;
use driver::Motion;
use messages::{JOINTS, deadline};
use nalgebra::{Unit, UnitQuaternion, Vector3};
use rand::SeedableRng;
use rand_pcg::Pcg64;
use robot::{Hull, Pose};
use std::collections::HashMap;
use std::path::{Path, PathBuf};
use torture::attack::Attacker;
use torture::stages::{Stages, Subject};
use urdf_rs::{Geometry, JointType};

const TICKS: u64 = 30_000;
/// Ticks between two judgements of a posture and of the end of its plan: 30 ms.
const EVERY: u64 = 45;

/// Links that move within a shoulder.
const SHOULDERS: [&str; 2] = ["arm_left_2_link", "arm_right_2_link"];

/// The convex hull of one collision mesh, in the frame of the link that carries it.
struct Piece {
    link: String,
    hull: Hull,
    /// A ball around it: centre in the link's frame, radius, m.
    ball: (Vector3<f64>, f64),
    /// The movable joint above it. None if it stands on the base.
    moved_by: Option<String>,
}

struct Meshes {
    robot: urdf_rs::Robot,
    pieces: Vec<Piece>,
    /// Pieces that can come nearer to each other and have more than one joint between them.
    pairs: Vec<(usize, usize)>,
}

/// Returns the nearest joint above a link that is one of the 17. The search skips fixed joints and fingers.
fn moved_by<'a>(robot: &'a urdf_rs::Robot, link: &str, names: &[String]) -> Option<&'a urdf_rs::Joint> {
    let mut link = link.to_owned();
    loop {
        let joint = robot.joints.iter().find(|joint| joint.child.link == link)?;
        if names.contains(&joint.name) {
            return Some(joint);
        }
        link = joint.parent.link.clone();
    }
}

impl Meshes {
    fn read(folder: &Path, names: &[String; JOINTS]) -> Self {
        let robot = urdf_rs::read_file(folder.join("tiago_dual.urdf")).unwrap();
        let mut pieces = Vec::new();
        for link in &robot.links {
            for element in &link.collision {
                let Geometry::Mesh { filename, scale } = &element.geometry else { continue };
                let (_, below) = filename.rsplit_once("/meshes/").unwrap();
                let scale = scale.map_or(Vector3::repeat(1.0), |scale| Vector3::from(*scale));
                let pose = Pose::from_xyz_rpy(*element.origin.xyz, *element.origin.rpy);
                let triangles = read_mesh(&folder.join("meshes").join(below)).unwrap();
                let points: Vec<_> =
                    triangles.iter().flatten().map(|p| pose.transform_point(&p.component_mul(&scale))).collect();
                let hull = Hull::new(&points).unwrap();
                let centre = points.iter().sum::<Vector3<f64>>() / points.len() as f64;
                let radius = points.iter().map(|p| (p - centre).norm()).fold(0.0, f64::max);
                let moved_by = moved_by(&robot, &link.name, names).map(|joint| joint.name.clone());
                pieces.push(Piece { link: link.name.clone(), hull, ball: (centre, radius), moved_by });
            }
        }
        // The movable joint above the parent of the joint above. It defines which links are adjacent.
        let above = |name: &Option<String>| {
            let joint = robot.joints.iter().find(|joint| Some(&joint.name) == name.as_ref())?;
            Some(moved_by(&robot, &joint.parent.link, names).map(|joint| joint.name.clone()))
        };
        let mut pairs = Vec::new();
        for b in 0..pieces.len() {
            for a in 0..b {
                let (first, second) = (&pieces[a].moved_by, &pieces[b].moved_by);
                let adjacent = above(first).as_ref() == Some(second) || above(second).as_ref() == Some(first);
                // The torso is not convex. With joint 1 at its upper limit, an arm's second link is inside the
                // torso's hull but outside the torso itself. This holds for every position of joint 2. That
                // pair is proved with the torso cut into parts (`collision check`).
                let links = [pieces[a].link.as_str(), pieces[b].link.as_str()];
                let shoulder = links.contains(&"torso_lift_link") && links.iter().any(|link| SHOULDERS.contains(link));
                if first != second && !adjacent && !shoulder {
                    pairs.push((a, b));
                }
            }
        }
        Self { robot, pieces, pairs }
    }

    /// Poses of the links in the root's frame, with joints that are not among `q` at zero.
    fn poses(&self, q: &HashMap<&str, f64>) -> HashMap<&str, Pose> {
        let mut poses: HashMap<&str, Pose> = HashMap::new();
        let child = |name: &str| self.robot.joints.iter().any(|joint| joint.child.link == name);
        let root = self.robot.links.iter().find(|link| !child(&link.name)).unwrap();
        poses.insert(&root.name, Pose::identity());
        while poses.len() < self.robot.links.len() {
            for joint in &self.robot.joints {
                let Some(parent) = poses.get(joint.parent.link.as_str()) else { continue };
                let at = q.get(joint.name.as_str()).copied().unwrap_or(0.0);
                let axis = Unit::new_normalize(Vector3::from(*joint.axis.xyz));
                let turn = match joint.joint_type {
                    JointType::Fixed => Pose::identity(),
                    JointType::Prismatic => Pose { t: axis.into_inner() * at, ..Pose::identity() },
                    _ => Pose { r: UnitQuaternion::from_axis_angle(&axis, at).into(), t: Vector3::zeros() },
                };
                let origin = Pose::from_xyz_rpy(*joint.origin.xyz, *joint.origin.rpy);
                poses.insert(&joint.child.link, parent.compose(&origin).compose(&turn));
            }
        }
        poses
    }

    /// Returns the least distance of two hulls and their links, m. Skips pairs that are farther apart than
    /// `least_m`.
    fn nearest(&self, names: &[String; JOINTS], q: &[f64; JOINTS]) -> (f64, String) {
        let poses = self.poses(&names.iter().map(String::as_str).zip(*q).collect());
        let mut least = (f64::INFINITY, String::new());
        for &(a, b) in &self.pairs {
            let (a, b) = (&self.pieces[a], &self.pieces[b]);
            let (pose_a, pose_b) = (&poses[a.link.as_str()], &poses[b.link.as_str()]);
            let between = pose_a.transform_point(&a.ball.0) - pose_b.transform_point(&b.ball.0);
            if between.norm() - a.ball.1 - b.ball.1 < least.0 {
                let distance = a.hull.distance_m(pose_a, &b.hull, pose_b);
                if distance < least.0 {
                    least = (distance, format!("{} - {}", a.link, b.link));
                }
            }
        }
        least
    }
}

/// Returns the posture at which the plan of a command rests.
fn rest(motion: &Motion) -> [f64; JOINTS] {
    let mut motion = *motion;
    motion.play(u64::MAX);
    motion.q
}

/// Returns the least distance over an attack.
fn attack(subject: &Subject, meshes: &Meshes, seed: u64, ticks: u64) -> (f64, String) {
    let model = &subject.model;
    let mut stages = Stages::at_rest(subject, model.home);
    let mut attacker = Attacker::new(model, Pcg64::seed_from_u64(seed));
    let (mut q, mut least) = (model.home, (f64::INFINITY, String::new()));
    for k in 1..=ticks {
        attacker.next(k, &q);
        let (out, _) = stages.tick(k, deadline(k), attacker.target(), attacker.permit);
        q = out.motion.q;
        if k.is_multiple_of(EVERY) {
            for posture in [q, rest(&out.motion)] {
                let found = meshes.nearest(&model.joint_names, &posture);
                if found.0 < least.0 {
                    least = found;
                }
            }
        }
    }
    least
}

#[test]
fn meshes_under_attack_stay_apart_only_with_certificate() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let folder: PathBuf = root.join("../shared/robots/tiago_dual");
    if !folder.join("meshes").exists() {
        eprintln!("skipped: {} is not there", folder.join("meshes").display());
        return;
    }
    let file = root.join("config/robots/tiago_dual.toml");
    let load = |certified| Subject::load(Path::new(""), Some(&file), certified).unwrap();
    let subject = load(true);
    let meshes = Meshes::read(&folder, &subject.model.joint_names);
    assert!(meshes.pieces.len() > 20 && meshes.pairs.len() > 200, "{} {}", meshes.pieces.len(), meshes.pairs.len());
    let (least_m, pair) = attack(&subject, &meshes, 3, TICKS);
    println!(
        "{} hulls, {} pairs: least distance {:.2} mm, {pair}",
        meshes.pieces.len(),
        meshes.pairs.len(),
        least_m * 1e3
    );
    assert!(least_m > 0.0, "{pair} touch");
    let (without_m, pair) = attack(&load(false), &meshes, 3, TICKS);
    assert!(without_m == 0.0, "without the certificate nothing touched: {without_m} m, {pair}");
}
