//! The robot's body by the gate's own kinematics. It takes origins, axes and parents from the model, but none
//! of the model's arithmetic.
//!
//! Every body's frame is first turned so that its joint moves about or along z. A_j is the pose of joint j's
//! frame in its parent's frame at position zero. Then
//!
//! ```text
//! base_from_j(q) = base_from_parent(q) A_j Rz(q_j)     for a joint that turns
//! base_from_j(q) = base_from_parent(q) A_j Tz(q_j)     for a joint that slides
//! ```
//!
//! Rz changes only two columns.
//!
//! # Levers
//!
//! Take a point of the capsule's axis and its distance from the axis of joint k. The *lever* R_k of joint k
//! on the capsule is the largest such distance over all points and all postures. It is at most the next
//! joint's distance from the axis plus the lengths of all later offsets. For a prismatic joint it is 1.
//!
//! Let two postures differ by d_k in joint k, and in no other joint. Then the points of the capsule differ by
//! at most R_k |d_k|, because one posture becomes the other by a turn of d_k about one axis. Joint by joint,
//! the distance of two capsules changes by at most sum_k R_k |d_k|. Only joints between their bodies count,
//! because a joint that carries both moves them as one.

use messages::JOINTS_MAX;
use nalgebra::{Matrix3, Vector3};
use robot::{CAPSULES_MAX, Model, Solid};

use crate::clearance::{Axis, above_plane, between_segments, from_box};

/// Set of joints. Bit j is joint j.
pub(super) type JointSet = u32;

/// A joint with its frame turned so that it moves about or along z.
#[derive(Clone, Copy, Debug)]
struct Joint {
    /// Parent body: 0 is the base, and 1 + j moves with joint j. Its index is always smaller than that of
    /// this joint's body.
    parent: usize,
    /// A_j: rotation, and translation (m).
    r: Matrix3<f64>,
    t: Vector3<f64>,
    slides: bool,
    /// Largest magnitude of the position of a prismatic joint, m.
    stroke_m: f64,
}

/// Pose of a body in the base frame.
#[derive(Clone, Copy, Debug)]
pub(super) struct Placed {
    pub(super) r: Matrix3<f64>,
    pub(super) t: Vector3<f64>,
}

/// Poses of all bodies.
pub(super) type Places = [Placed; JOINTS_MAX + 1];

/// Returns all bodies at the base.
pub(super) fn unplaced() -> Places {
    [Placed { r: Matrix3::identity(), t: Vector3::zeros() }; JOINTS_MAX + 1]
}

/// A capsule in the turned frame of its body.
#[derive(Clone, Debug)]
struct Capsule {
    body: usize,
    ends: [Vector3<f64>; 2],
    radius_m: f64,
    /// The joints that carry the capsule, from the base on, each with its lever (m, or 1 for a prismatic joint).
    carried: Vec<(usize, f64)>,
}

/// The second member of a pair: the capsule or solid from which a capsule must stay apart.
#[derive(Clone, Copy, Debug)]
enum Other {
    /// Another capsule, with a place in its list of joints. The joints from this place on move it relative to
    /// the common body.
    Capsule(usize, usize),
    /// A solid that is fixed to the base.
    Obstacle(usize),
}

/// A pair that must stay apart.
#[derive(Clone, Copy, Debug)]
struct Pair {
    a: usize,
    /// Place in the list of joints of `a`. The joints from this place on move `a` relative to the common body.
    from: usize,
    other: Other,
    /// All joints, and all capsules (bit i is capsule i), that the pair's distance depends on.
    needed: (JointSet, u64),
}

/// Largest displacement of the capsules of each body by the joints from a place of its list on, m. There is a row for each
/// body and place.
pub(super) type Rows = [f64; ROWS];

const ROWS: usize = (JOINTS_MAX + 1) * (JOINTS_MAX + 1);

/// Rows of bodies that have not moved.
pub(super) const NO_ROWS: Rows = [0.0; ROWS];

const fn row(body: usize, place: usize) -> usize {
    body * (JOINTS_MAX + 1) + place
}

/// Bodies, capsules, obstacles and checked pairs of one robot.
#[derive(Clone, Debug)]
pub(super) struct Body {
    joints: Vec<Joint>,
    capsules: Vec<Capsule>,
    obstacles: Vec<Solid>,
    pairs: Vec<Pair>,
    /// For both sides of each pair, the row of the body from the first joint that is not shared. An obstacle has that of
    /// the base. They stand apart from the pairs, because every tick reads all of them.
    rows: Vec<[u16; 2]>,
    /// For each body, the joints that carry it, each with the largest lever on one of its capsules.
    carried: Vec<Vec<(usize, f64)>>,
    /// Elbows and hands, whose speed is bounded. They are capsules of which both ends are one point.
    points: Vec<Capsule>,
}

/// Returns a rotation whose third column is `axis`.
fn with_third(axis: &Vector3<f64>) -> Matrix3<f64> {
    let along = axis.normalize();
    // The coordinate axis that is farthest from parallel to it, so that the product below is far from zero.
    let least = along.iamin();
    let first = along.cross(&Vector3::ith(least, 1.0)).normalize();
    Matrix3::from_columns(&[first, along.cross(&first), along])
}

impl Body {
    pub(super) fn new(model: &Model) -> Self {
        let mut turned = [Matrix3::identity(); JOINTS_MAX + 1];
        let mut joint = |j: usize| {
            let (at_zero, axis) = model.joint_at_zero(j);
            let parent = model.parent_body(j + 1).unwrap_or(0);
            turned[j + 1] = with_third(&axis);
            let (limits, stops) = (&model.limits[j], &model.urdf_limits[j]);
            let stroke_m = [limits.q_min, limits.q_max, stops.q_min, stops.q_max].map(f64::abs);
            Joint {
                parent,
                r: turned[parent].transpose() * at_zero.r * turned[j + 1],
                t: turned[parent].transpose() * at_zero.t,
                slides: model.prismatic[j],
                stroke_m: stroke_m.into_iter().fold(0.0, f64::max),
            }
        };
        let joints = (0..model.count).map(&mut joint).collect();
        let (capsules, obstacles, pairs, rows, carried, points) = (vec![], vec![], vec![], vec![], vec![], vec![]);
        let mut body = Self { joints, capsules, obstacles, pairs, rows, carried, points };
        let on = |at: usize, ends: [Vector3<f64>; 2]| ends.map(|end| turned[at].transpose() * end);
        let capsules = model.capsules.iter().map(|c| body.carried(c.body, on(c.body, [c.a, c.b]), c.radius_m));
        let points = model.speed_points().map(|point| body.carried(point.body, on(point.body, [point.at; 2]), 0.0));
        (body.capsules, body.points) = (capsules.collect(), points.to_vec());
        body.carried = (0..=model.count).map(|at| body.largest_levers(at)).collect();
        body.obstacles = model.obstacles.iter().map(|obstacle| obstacle.solid).collect();
        body.pairs = model.pairs.iter().map(|pair| body.pair(pair.a, pair.b)).collect();
        for a in (0..body.capsules.len()).filter(|&a| body.capsules[a].body != 0) {
            let needed = (body.ancestors(body.capsules[a].body), 1 << a);
            let pair = |k| Pair { a, from: 0, other: Other::Obstacle(k), needed };
            body.pairs.extend((0..body.obstacles.len()).map(pair));
        }
        let side = |capsule: usize, from| row(body.capsules[capsule].body, from) as u16;
        let rows = body.pairs.iter().map(|pair| match pair.other {
            Other::Capsule(b, from) => [side(pair.a, pair.from), side(b, from)],
            Other::Obstacle(_) => [side(pair.a, pair.from), row(0, 0) as u16],
        });
        body.rows = rows.collect();
        body
    }

    fn carried(&self, body: usize, ends: [Vector3<f64>; 2], radius_m: f64) -> Capsule {
        let lever = |j: usize| self.lever(j, body, &ends[0]).max(self.lever(j, body, &ends[1]));
        let carried = self.carriers(body).map(|j| (j, lever(j))).collect();
        Capsule { body, ends, radius_m, carried }
    }

    fn pair(&self, a: usize, b: usize) -> Pair {
        let sets = [a, b].map(|i| self.ancestors(self.capsules[i].body));
        // A parent has a smaller index than its child. So the joints that both lists share are first in both.
        let from = (sets[0] & sets[1]).count_ones() as usize;
        Pair { a, from, other: Other::Capsule(b, from), needed: (sets[0] | sets[1], 1 << a | 1 << b) }
    }

    fn largest_levers(&self, body: usize) -> Vec<(usize, f64)> {
        let on_body = || self.capsules.iter().filter(|capsule| capsule.body == body);
        let most = |place: usize| on_body().map(|capsule| capsule.carried[place].1).fold(0.0, f64::max);
        self.carriers(body).enumerate().map(|(place, j)| (j, most(place))).collect()
    }

    /// Returns the joints between the base and `body`.
    fn ancestors(&self, body: usize) -> JointSet {
        let (mut set, mut at) = (0, body);
        while at != 0 {
            set |= 1 << (at - 1);
            at = self.joints[at - 1].parent;
        }
        set
    }

    /// Returns the same joints in order, from the base on.
    fn carriers(&self, body: usize) -> impl Iterator<Item = usize> {
        let set = self.ancestors(body);
        (0..self.joints.len()).filter(move |j| set & 1 << j != 0)
    }

    /// Returns the lever of joint `j` on a point of `body`, which the joint carries.
    fn lever(&self, j: usize, body: usize, point: &Vector3<f64>) -> f64 {
        if self.joints[j].slides {
            return 1.0;
        }
        let (mut beyond, mut first, mut at) = (0.0, *point, body);
        while at != j + 1 {
            let joint = &self.joints[at - 1];
            beyond += first.norm() + if joint.slides { joint.stroke_m } else { 0.0 };
            (first, at) = (joint.t, joint.parent);
        }
        first.x.hypot(first.y) + beyond
    }

    /// Computes the poses of the bodies that the joints of `set` move, at the positions `q` (rad, m). `set`
    /// must contain the ancestors of each of its joints. The other entries stay as they are.
    pub(super) fn place(&self, q: &[f64; JOINTS_MAX], set: JointSet, places: &mut Places) {
        for (j, joint) in self.joints.iter().enumerate().filter(|(j, _)| set & 1 << j != 0) {
            let parent = places[joint.parent];
            let mut r = parent.r * joint.r;
            let mut t = parent.r * joint.t + parent.t;
            if joint.slides {
                t += r.column(2) * q[j];
            } else {
                let (sin, cos) = q[j].sin_cos();
                let [x, y] = [r.column(0).into_owned(), r.column(1).into_owned()];
                r.set_column(0, &(x * cos + y * sin));
                r.set_column(1, &(y * cos - x * sin));
            }
            places[j + 1] = Placed { r, t };
        }
    }

    pub(super) fn capsule_count(&self) -> usize {
        self.capsules.len()
    }

    pub(super) fn pair_count(&self) -> usize {
        self.pairs.len()
    }

    /// Returns the joints and the capsules that a pair's distance depends on.
    pub(super) fn needed(&self, pair: usize) -> (JointSet, u64) {
        self.pairs[pair].needed
    }

    /// Returns the indices of a pair's capsules in the robot file. For an obstacle the second is the number
    /// of capsules plus its index.
    pub(super) fn named(&self, pair: usize) -> [u32; 2] {
        let Pair { a, other, .. } = self.pairs[pair];
        let b = match other {
            Other::Capsule(b, _) => b,
            Other::Obstacle(k) => self.capsules.len() + k,
        };
        [a as u32, b as u32]
    }

    /// Returns the capsule in the base frame.
    pub(super) fn axis(&self, capsule: usize, places: &Places) -> Axis {
        let Capsule { body, ends, radius_m, .. } = &self.capsules[capsule];
        let [a, b] = ends.map(|end| places[*body].r * end + places[*body].t);
        Axis::new(a, b, *radius_m)
    }

    pub(super) fn point_count(&self) -> usize {
        self.points.len()
    }

    /// Returns the body of elbow or hand `i`.
    pub(super) fn point_body(&self, i: usize) -> usize {
        self.points[i].body
    }

    /// Returns the joints that move it.
    pub(super) fn point_joints(&self, i: usize) -> JointSet {
        self.points[i].carried.iter().fold(0, |set, (j, _)| set | 1 << j)
    }

    /// Upper bound of its speed while the joints are no faster than `v` (rad/s, m/s), m/s.
    pub(super) fn fastest(&self, i: usize, v: &[f64; JOINTS_MAX]) -> f64 {
        self.points[i].carried.iter().map(|&(j, lever)| lever * v[j].abs()).sum()
    }

    /// Its velocity in the base frame, m/s.
    pub(super) fn point_velocity(&self, i: usize, v: &[f64; JOINTS_MAX], places: &Places) -> Vector3<f64> {
        let Capsule { body, ends, carried, .. } = &self.points[i];
        let at = places[*body].r * ends[0] + places[*body].t;
        let mut velocity = Vector3::zeros();
        for &(j, _) in carried {
            let axis = places[j + 1].r.column(2).into_owned();
            velocity += if self.joints[j].slides { axis } else { axis.cross(&(at - places[j + 1].t)) } * v[j];
        }
        velocity
    }

    /// Cheap lower bound of a pair's distance, m.
    pub(super) fn at_most(&self, pair: usize, axes: &[Axis; CAPSULES_MAX]) -> f64 {
        let Pair { a, other, .. } = &self.pairs[pair];
        match *other {
            Other::Capsule(b, _) => axes[*a].bound_m(&axes[b]),
            Other::Obstacle(k) => match &self.obstacles[k] {
                Solid::HalfSpace { normal, offset_m } => {
                    above_plane(&axes[*a].ends, normal, *offset_m) - axes[*a].radius_m
                }
                Solid::Box { center, half_m, .. } => axes[*a].point_bound_m(center, half_m.norm()),
            },
        }
    }

    /// The distance of a pair, m.
    pub(super) fn distance(&self, pair: usize, axes: &[Axis; CAPSULES_MAX]) -> f64 {
        let Pair { a, other, .. } = &self.pairs[pair];
        let a = &axes[*a];
        let of_axis = match *other {
            Other::Capsule(b, _) => between_segments(&a.ends, &axes[b].ends) - axes[b].radius_m,
            Other::Obstacle(k) => match &self.obstacles[k] {
                Solid::HalfSpace { normal, offset_m } => above_plane(&a.ends, normal, *offset_m),
                Solid::Box { center, r, half_m } => from_box(&a.ends.map(|end| r.tr_mul(&(end - center))), half_m),
            },
        };
        of_axis - a.radius_m
    }

    /// Adds to each row the largest displacement of the body's capsules by joints that move by `travel` (rad, m), m.
    pub(super) fn move_by(&self, travel: &[f64; JOINTS_MAX], rows: &mut Rows) {
        for (body, levers) in self.carried.iter().enumerate() {
            let mut sum = 0.0;
            for (row, &(j, lever)) in rows[row(body, 0)..row(body, levers.len())].iter_mut().zip(levers).rev() {
                sum += lever * travel[j];
                *row += sum;
            }
        }
    }

    /// Largest change of a pair's distance, m.
    #[inline]
    pub(super) fn change(&self, pair: usize, moved: &Rows) -> f64 {
        let [a, b] = self.rows[pair].map(usize::from);
        moved[a] + moved[b]
    }

    /// Returns the joints between a pair's bodies, on both sides, each with its lever.
    pub(super) fn between(&self, pair: usize) -> impl Iterator<Item = (usize, f64)> {
        let Pair { a, from, other, .. } = self.pairs[pair];
        let second = match other {
            Other::Capsule(b, from) => &self.capsules[b].carried[from..],
            Other::Obstacle(_) => &[],
        };
        self.capsules[a].carried[from..].iter().chain(second).copied()
    }
}
