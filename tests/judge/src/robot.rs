//! A robot as the judge knows it: where its bodies are, how near they come, and what the joints may do.

use crate::nearest;
use messages::JOINTS_MAX;
use nalgebra::{Matrix3, Rotation3, Unit, Vector3};
use plant::{segment_box, segment_plane};
use rand::{Rng, RngExt};
use robot::{Frames, JointLimits, Model, Obstacle, Pose, Solid, segment_distance_oracle};
use std::path::Path;

/// A joint of a tree whose frames are parallel at position zero.
#[derive(Clone, Copy, Debug)]
pub struct TreeJoint {
    /// The body that carries it. Body 0 is the base, body `1 + j` moves with joint `j`.
    pub parent: usize,
    /// Its place in the parent body's frame, m.
    pub origin: [f64; 3],
    /// Unit axis.
    pub axis: [f64; 3],
    /// True if it slides.
    pub prismatic: bool,
}

/// The joints of an invented robot. A parent never has a greater index than its child.
pub type Tree = Vec<TreeJoint>;

#[derive(Clone, Debug)]
enum Kinematics {
    Model(Box<Model>),
    Tree(Tree),
}

/// A capsule: its body, the ends of its axis in the body's frame, and its radius, m.
#[derive(Clone, Copy, Debug)]
struct Capsule {
    body: usize,
    ends: [Vector3<f64>; 2],
    radius_m: f64,
}

/// Joints of each arm of an invented robot.
const INVENTED_ARM: usize = 7;

/// A robot: of a robot file, or invented.
#[derive(Clone, Debug)]
pub struct Robot {
    /// Number of joints. The last ones are the arms'. Arrays are longer.
    pub count: usize,
    /// For each joint of the right arm: its position in a posture that mirrors the left arm's, over the left one's.
    pub signs: Vec<f64>,
    /// Limits of the joints.
    pub limits: [JointLimits; JOINTS_MAX],
    /// Home posture, rad or m.
    pub home: [f64; JOINTS_MAX],
    /// Least clearance, m.
    pub d_min_m: f64,
    kinematics: Kinematics,
    capsules: Vec<Capsule>,
    pairs: Vec<[usize; 2]>,
}

/// Obstacles around a shipped robot: a floor at this height, and a box before its left arm.
pub fn surroundings(floor_m: f64) -> Vec<Obstacle> {
    let solids = [
        Solid::HalfSpace { normal: Vector3::z(), offset_m: floor_m },
        Solid::Box { center: Vector3::new(0.6, 0.3, 0.8), r: Matrix3::identity(), half_m: Vector3::repeat(0.1) },
    ];
    solids.map(|solid| Obstacle { name: "solid".into(), solid }).to_vec()
}

impl Robot {
    /// Creates the robot of a model, with the obstacles of the model.
    pub fn new(model: Model) -> Self {
        let capsules = model.capsules.iter();
        Self {
            count: model.count,
            signs: model.arms[1].joint_signs().collect(),
            limits: model.limits,
            home: model.home,
            d_min_m: model.d_min_m,
            capsules: capsules.map(|c| Capsule { body: c.body, ends: [c.a, c.b], radius_m: c.radius_m }).collect(),
            pairs: model.pairs.iter().map(|pair| [pair.a, pair.b]).collect(),
            kinematics: Kinematics::Model(Box::new(model)),
        }
    }

    /// Loads the robot of a robot file. Its URDF lies beside it.
    pub fn load(path: &str) -> Self {
        let read = |path: &Path| std::fs::read_to_string(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
        let toml = read(Path::new(path));
        let urdf = robot::urdf_file(path, &toml).expect("a robot file");
        let beside = Path::new(path).with_file_name(&urdf);
        Self::new(Model::from_text(path, &toml, &urdf, &read(&beside)).expect("a robot"))
    }

    /// Creates an invented robot. A capsule is its body, both ends of its axis (m), and its radius (m).
    pub fn invented(
        tree: Tree,
        limits: [JointLimits; JOINTS_MAX],
        home: [f64; JOINTS_MAX],
        d_min_m: f64,
        capsules: impl Iterator<Item = (usize, [Vector3<f64>; 2], f64)>,
        pairs: Vec<[usize; 2]>,
    ) -> Self {
        let capsules = capsules.map(|(body, ends, radius_m)| Capsule { body, ends, radius_m }).collect();
        let (count, kinematics) = (tree.len(), Kinematics::Tree(tree));
        Self { count, signs: vec![1.0; INVENTED_ARM], limits, home, d_min_m, kinematics, capsules, pairs }
    }

    /// The model that it was made of. None if it is invented.
    pub fn model(&self) -> Option<&Model> {
        match &self.kinematics {
            Kinematics::Model(model) => Some(model),
            Kinematics::Tree(_) => None,
        }
    }

    /// Draws a posture anywhere within the limits.
    pub fn posture(&self, rng: &mut impl Rng) -> [f64; JOINTS_MAX] {
        let mut q = [0.0; JOINTS_MAX];
        for (q, limits) in q.iter_mut().zip(&self.limits).take(self.count) {
            *q = rng.random_range(limits.q_min..=limits.q_max);
        }
        q
    }

    /// Poses of all bodies in the base frame.
    pub fn poses(&self, q: &[f64; JOINTS_MAX]) -> [Pose; JOINTS_MAX + 1] {
        let mut frames = Frames::default();
        match &self.kinematics {
            Kinematics::Model(model) => model.forward(q, &mut frames),
            Kinematics::Tree(tree) => {
                for (j, joint) in tree.iter().enumerate() {
                    let (origin, axis) = (Vector3::from(joint.origin), Vector3::from(joint.axis));
                    let own = if joint.prismatic {
                        Pose { t: origin + axis * q[j], ..Pose::identity() }
                    } else {
                        let turn = Rotation3::from_axis_angle(&Unit::new_normalize(axis), q[j]);
                        Pose { r: turn.into_inner(), t: origin }
                    };
                    frames.base_from_body[j + 1] = frames.base_from_body[joint.parent].compose(&own);
                }
            }
        }
        frames.base_from_body
    }

    /// Least clearance at `q`, m: of the checked pairs by parry's distance of their axes, and of the moving capsules
    /// from the obstacles.
    pub fn clearance(&self, q: &[f64; JOINTS_MAX]) -> f64 {
        let poses = self.poses(q);
        let axis = |c: &Capsule| c.ends.map(|end| poses[c.body].transform_point(&end));
        let axes: Vec<_> = self.capsules.iter().map(axis).collect();
        let mut least = f64::INFINITY;
        for &[a, b] in &self.pairs {
            let ([a0, a1], [b0, b1]) = (&axes[a], &axes[b]);
            let radii = self.capsules[a].radius_m + self.capsules[b].radius_m;
            // Balls around both capsules: the distance is at least that of the centres less both radii.
            let apart = ((a0 + a1) - (b0 + b1)).norm() - (a1 - a0).norm() - (b1 - b0).norm();
            let farther = apart / 2.0 - radii > least;
            if !farther {
                least = least.min(segment_distance_oracle(a0, a1, b0, b1) - radii);
            }
        }
        let obstacles = self.model().map_or(&[][..], |model| &model.obstacles);
        for (capsule, axis) in self.capsules.iter().zip(&axes).filter(|(capsule, _)| capsule.body != 0) {
            for obstacle in obstacles {
                least = least.min(from_solid(&obstacle.solid, axis) - capsule.radius_m);
            }
        }
        least
    }

    /// Derivative by each joint of the distance of a near pair, m per rad or m. `rank` is 0 for the nearest pair. The
    /// last rank is the nearest obstacle, if there is one.
    pub(crate) fn gradient(&self, q: &[f64; JOINTS_MAX], rank: usize) -> Option<[f64; JOINTS_MAX]> {
        let Some(model) = self.model() else { return Some(nearest::quotient(q, |q| self.clearance(q))) };
        let outside = if rank == nearest::RANKS - 1 { nearest::of_obstacle(model, q) } else { None };
        outside.or_else(|| nearest::of_pair(model, q, rank))
    }
}

fn from_solid(solid: &Solid, axis: &[Vector3<f64>; 2]) -> f64 {
    match solid {
        Solid::HalfSpace { normal, offset_m } => segment_plane(axis, normal, *offset_m),
        Solid::Box { center, r, half_m } => segment_box(&axis.map(|p| r.tr_mul(&(p - center))), half_m),
    }
}
