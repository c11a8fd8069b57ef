//! The manufacturer's collision meshes, which the capsules stand for, placed with kinematics of their own.

use collision::mesh::read_mesh;
use messages::JOINTS_MAX;
use nalgebra::{Unit, UnitQuaternion, Vector3};
use robot::{Hull, Pose, Surface};
use std::collections::HashMap;
use std::path::Path;
use urdf_rs::{Geometry, JointType};

/// Links that move within a shoulder.
const SHOULDERS: [&str; 2] = ["arm_left_2_link", "arm_right_2_link"];

/// One collision mesh and its convex hull, in the frame of the link that carries it.
struct Piece {
    link: String,
    surface: Surface,
    hull: Hull,
    /// A ball around it: centre in the link's frame, radius, m.
    ball: (Vector3<f64>, f64),
    /// The movable joint above it. None if it stands on the base.
    moved_by: Option<String>,
}

/// Pieces that can come nearer to each other and have more than one joint between them.
struct Pair {
    a: usize,
    b: usize,
    /// True if the hulls of both keep apart, and not only the meshes themselves.
    convex: bool,
}

/// The collision meshes of a robot.
pub struct Meshes {
    names: Vec<String>,
    robot: urdf_rs::Robot,
    pieces: Vec<Piece>,
    pairs: Vec<Pair>,
}

/// Returns the nearest joint above a link that is commanded. The search skips fixed joints and fingers.
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
    /// Reads the meshes of the shipped robot from `../shared` beside the repository.
    /// `names` are the joints' names in order.
    ///
    /// # Panics
    /// Panics if a file cannot be read.
    pub fn read(names: &[String]) -> Self {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/robots/tiago_dual");
        let robot = urdf_rs::read_file(folder.join("tiago_dual.urdf")).expect("a description");
        let mut pieces = Vec::new();
        for link in &robot.links {
            for element in &link.collision {
                let Geometry::Mesh { filename, scale } = &element.geometry else { continue };
                let (_, below) = filename.rsplit_once("/meshes/").expect("a mesh in its folder");
                let scale = scale.map_or(Vector3::repeat(1.0), |scale| Vector3::from(*scale));
                let pose = Pose::from_xyz_rpy(*element.origin.xyz, *element.origin.rpy);
                let triangles = read_mesh(&folder.join("meshes").join(below)).expect("a mesh");
                let place = |p: &Vector3<f64>| pose.transform_point(&p.component_mul(&scale));
                let triangles: Vec<_> = triangles.iter().map(|corners| [0, 1, 2].map(|i| place(&corners[i]))).collect();
                let surface = Surface::new(&triangles).expect("a mesh with triangles");
                let points = triangles.as_flattened();
                let hull = Hull::new(points).expect("a mesh with a volume");
                let centre = points.iter().sum::<Vector3<f64>>() / points.len() as f64;
                let radius = points.iter().map(|p| (p - centre).norm()).fold(0.0, f64::max);
                let moved_by = moved_by(&robot, &link.name, names).map(|joint| joint.name.clone());
                pieces.push(Piece { link: link.name.clone(), surface, hull, ball: (centre, radius), moved_by });
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
                // torso's hull but outside the torso itself.
                let links = [pieces[a].link.as_str(), pieces[b].link.as_str()];
                let shoulder = links.contains(&"torso_lift_link") && links.iter().any(|link| SHOULDERS.contains(link));
                if first != second && !adjacent {
                    pairs.push(Pair { a, b, convex: !shoulder });
                }
            }
        }
        Self { names: names.to_vec(), robot, pieces, pairs }
    }

    /// Number of meshes, and of pairs that must keep apart.
    pub fn counts(&self) -> [usize; 2] {
        [self.pieces.len(), self.pairs.len()]
    }

    /// Poses of the links in the root's frame, with joints that are not among `q` at zero.
    fn poses(&self, q: &HashMap<&str, f64>) -> HashMap<&str, Pose> {
        let mut poses: HashMap<&str, Pose> = HashMap::new();
        let child = |name: &str| self.robot.joints.iter().any(|joint| joint.child.link == name);
        let root = self.robot.links.iter().find(|link| !child(&link.name)).expect("a root");
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

    /// Lowers `least` (m, and the links) to the least distance of a pair at `q`.
    pub fn nearest(&self, q: &[f64; JOINTS_MAX], least: &mut (f64, String)) {
        let poses = self.poses(&self.names.iter().map(String::as_str).zip(*q).collect());
        for pair in &self.pairs {
            let (a, b) = (&self.pieces[pair.a], &self.pieces[pair.b]);
            let (pose_a, pose_b) = (&poses[a.link.as_str()], &poses[b.link.as_str()]);
            let between = pose_a.transform_point(&a.ball.0) - pose_b.transform_point(&b.ball.0);
            if between.norm() - a.ball.1 - b.ball.1 >= least.0 {
                continue;
            }
            let mut distance_m = a.hull.distance_m(pose_a, &b.hull, pose_b);
            if !pair.convex && distance_m < least.0 {
                distance_m = a.surface.distance_m(pose_a, &b.surface, pose_b);
            }
            if distance_m < least.0 {
                *least = (distance_m, format!("{} - {}", a.link, b.link));
            }
        }
    }
}
