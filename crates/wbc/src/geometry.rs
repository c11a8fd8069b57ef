//! The collision model for the certificate: capsules on bodies, solids on the base, and the pairs that must
//! stay apart. For each pair it lists the joints that change its distance.

use crate::chain::{BODIES, JointSet, KinematicChain, Placements, joints};
use crate::config::WbcError;
use crate::interface::{Controllers, Deviation, Interface};
use crate::interval::Bounds;
use crate::solid;
use crate::trajectory::Swing;
use messages::JOINTS_MAX;
use nalgebra::Vector3;
use robot::Solid;

/// A capsule in the frame of its body, m.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BodyCapsule {
    /// Body. 0 is the base.
    pub body: usize,
    /// One end of the axis.
    pub a: Vector3<f64>,
    /// The other end.
    pub b: Vector3<f64>,
    /// Radius.
    pub radius_m: f64,
}

/// A segment, m.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Segment {
    /// One end.
    pub a: Vector3<f64>,
    /// The other end.
    pub b: Vector3<f64>,
}

/// A capsule's side of a pair. The joints `from..` of its body's chain move it relative to the pair's common body.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Side {
    /// Index of the capsule. For an obstacle it is the number of capsules plus its index.
    pub(crate) capsule: usize,
    /// Index into the chain of the capsule's body.
    pub(crate) from: usize,
}

/// Two capsules, or a capsule A and an obstacle B, that must stay apart.
#[derive(Clone, Copy, Debug)]
pub(crate) struct CheckedPair {
    pub(crate) a: Side,
    pub(crate) b: Side,
    /// Index of the obstacle, if B is not a capsule.
    pub(crate) obstacle: Option<usize>,
    /// Sum of the capsules' radii, m.
    pub(crate) radii: f64,
    /// The deepest body that carries both. A motion that moves both in the same way cannot change their distance.
    pub(crate) common: usize,
    /// True if a revolute joint lies between the base and `common`, so that a direction fixed in `common` turns.
    pub(crate) turns: bool,
    /// The joints that change the distance.
    pub(crate) between: JointSet,
    /// These joints and all before them. The distance is computed from their placements.
    pub(crate) needed: JointSet,
}

/// For each body and each place in its list of joints, the path of the body's capsules by the joints from that place on, m.
pub(crate) type Rows = [f64; BODIES * BODIES];

/// Rows of bodies that have not moved.
pub(crate) const NO_ROWS: Rows = [0.0; BODIES * BODIES];

const fn row(body: usize, place: usize) -> usize {
    body * BODIES + place
}

/// One capsule with the reach of each joint of its chain. An obstacle has a point on the base, which no joint reaches.
#[derive(Clone, Debug)]
pub(crate) struct Shape {
    pub(crate) capsule: BodyCapsule,
    /// Joints from the base to the capsule's body.
    pub(crate) chain: Vec<usize>,
    /// Reach of each of them to the points of the axis, m (1 for a prismatic joint).
    pub(crate) reach: Vec<f64>,
}

impl Shape {
    /// Computes two bounds for each first joint s of the rest of the chain, relative to the body that carries
    /// joint s. They are B_s on the acceleration of any point of the axis (m/s^2), and the bound on its path
    /// (m). The recursion is that of [`certificate`](crate::certificate).
    #[inline]
    pub(crate) fn curves(
        &self,
        chain: &KinematicChain,
        swings: &[Swing; JOINTS_MAX],
        curve: &mut [f64; JOINTS_MAX + 1],
        path: &mut [f64; JOINTS_MAX + 1],
    ) {
        let tip = self.chain.len();
        (curve[tip], path[tip]) = (0.0, 0.0);
        let mut speed = 0.0;
        for s in (0..tip).rev() {
            let (j, r) = (self.chain[s], self.reach[s]);
            let Swing { v, a, path: length } = swings[j];
            let turning = if chain.links()[j].prismatic { 0.0 } else { v };
            curve[s] = curve[s + 1] + r * a + turning * (r * v + 2.0 * speed);
            path[s] = path[s + 1] + r * length;
            speed += r * v;
        }
    }
}

/// The collision model.
#[derive(Clone, Debug)]
pub struct Geometry {
    pub(crate) chain: KinematicChain,
    pub(crate) shapes: Vec<Shape>,
    pub(crate) pairs: Vec<CheckedPair>,
    pub(crate) obstacles: Vec<Solid>,
    /// Deviation by the robot's interface. None if it executes exactly what is commanded.
    pub(crate) deviation: Option<Deviation>,
    /// Distance that every pair keeps, m.
    pub(crate) d_min_m: f64,
    /// For each body, the joints that carry it, each with the largest reach to one of its capsules.
    carried: Vec<Vec<(usize, f64)>>,
    /// For each pair, the rows of both sides from the first joint that is not shared. They stand apart from the pairs,
    /// because every tick reads all of them.
    pair_rows: Vec<[u16; 2]>,
    /// For each pair, the joints that change its distance.
    between: Vec<JointSet>,
    /// False if every pair is measured in every tick, for a test that compares the decisions.
    pub(crate) skips: bool,
}

/// Largest number of capsules and obstacles. The certificate's marks are bits of a u128.
pub const CAPSULES_MAX: usize = 128;

impl Geometry {
    /// Creates the model of these capsules on `chain`. `pairs` are indices into `capsules`.
    pub fn new(
        chain: KinematicChain,
        capsules: &[BodyCapsule],
        pairs: &[[usize; 2]],
        d_min_m: f64,
    ) -> Result<Self, WbcError> {
        let at_most = |what, value, bound| {
            if value <= bound { Ok(()) } else { Err(WbcError::Collision { what, value, bound }) }
        };
        at_most("number of capsules", capsules.len(), CAPSULES_MAX)?;
        for capsule in capsules {
            at_most("body of a capsule", capsule.body, BODIES - 1)?;
        }
        let shapes: Vec<Shape> = capsules.iter().map(|c| shape(&chain, *c)).collect();
        let mut checked = Vec::with_capacity(pairs.len());
        for &[a, b] in pairs {
            at_most("capsule of a pair", a.max(b), capsules.len().saturating_sub(1))?;
            // Capsules of one body never move relative to each other, so there is nothing to certify.
            if capsules[a].body != capsules[b].body {
                checked.push(checked_pair(&chain, &shapes, a, b));
            }
        }
        let all = Self {
            chain,
            shapes,
            pairs: checked,
            obstacles: Vec::new(),
            deviation: None,
            d_min_m,
            carried: Vec::new(),
            pair_rows: Vec::new(),
            between: Vec::new(),
            skips: true,
        };
        Ok(all.with_rows())
    }

    /// Finds the largest reaches, and the rows of the pairs.
    fn with_rows(mut self) -> Self {
        let largest = |body: usize| {
            let on_body = || self.shapes.iter().filter(move |shape| shape.capsule.body == body);
            let most = |place: usize| on_body().map(|shape| shape.reach[place]).fold(0.0, f64::max);
            joints(self.chain.ancestors(body)).enumerate().map(|(place, j)| (j, most(place))).collect()
        };
        self.carried = (0..=self.chain.count()).map(largest).collect();
        let side = |side: Side| row(self.shapes[side.capsule].capsule.body, side.from) as u16;
        self.pair_rows = self.pairs.iter().map(|pair| [pair.a, pair.b].map(side)).collect();
        self.between = self.pairs.iter().map(|pair| pair.between).collect();
        self
    }

    /// Adds to each row the path of a body's capsules while the joints travel `paths` (rad or m), m.
    pub(crate) fn add_paths(&self, paths: &[f64; JOINTS_MAX], rows: &mut Rows) {
        for (body, carried) in self.carried.iter().enumerate() {
            let mut sum = 0.0;
            for (row, &(j, reach)) in rows[row(body, 0)..row(body, carried.len())].iter_mut().zip(carried).rev() {
                sum += reach * paths[j];
                *row += sum;
            }
        }
    }

    /// The sum of a pair's two rows of paths, m: the largest change of its distance.
    #[inline]
    pub(crate) fn change_m(&self, pair: usize, rows: &Rows) -> f64 {
        change_m(self.pair_rows[pair], rows)
    }

    /// Lists the pairs, and returns their number, that `fresh` joints change and that may come nearer than `nearest_m(pair)` while the bodies move
    /// by `paths`. `least` are lower bounds of their distances before, m.
    pub(crate) fn list_reachable(
        &self,
        fresh: JointSet,
        least: &[f64],
        paths: &Rows,
        nearest_m: impl Fn(usize) -> f64,
        list: &mut [u16],
    ) -> usize {
        let mut count = 0;
        let pairs = self.between.iter().zip(&self.pair_rows).zip(least);
        for (pair, ((between, rows), least)) in pairs.enumerate() {
            // Written so that NaN is listed.
            let apart = least - change_m(*rows, paths) >= nearest_m(pair);
            if between & fresh != 0 && !apart {
                list[count] = pair as u16;
                count += 1;
            }
        }
        count
    }

    /// Adds solids that stand on the base. Every moving capsule must stay apart from each.
    pub fn with_obstacles(mut self, obstacles: &[Solid]) -> Result<Self, WbcError> {
        let (capsules, value) = (self.shapes.len(), self.shapes.len() + obstacles.len());
        if value > CAPSULES_MAX {
            return Err(WbcError::Collision { what: "number of capsules and obstacles", value, bound: CAPSULES_MAX });
        }
        for solid in obstacles {
            self.shapes.push(obstacle(solid));
        }
        for a in (0..capsules).filter(|&a| self.shapes[a].capsule.body != 0) {
            for k in 0..obstacles.len() {
                let pair = checked_pair(&self.chain, &self.shapes, a, capsules + k);
                self.pairs.push(CheckedPair { obstacle: Some(k), ..pair });
            }
        }
        self.obstacles = obstacles.to_vec();
        Ok(self.with_rows())
    }

    /// Sets the interface through which the robot executes commands within `limits`. Add obstacles first.
    pub fn with_interface(
        mut self,
        interface: &Interface,
        controllers: &Controllers,
        limits: &[Bounds; JOINTS_MAX],
    ) -> Result<Self, WbcError> {
        self.deviation = Deviation::new(interface, controllers, limits, &self)?;
        Ok(self)
    }

    /// Measures every pair in every tick, if `skips` is false.
    pub(crate) fn with_skips(self, skips: bool) -> Self {
        Self { skips, ..self }
    }

    /// Bounds on the acceleration (m/s^2) and the path (m) of any point of a capsule's axis in the base frame while the
    /// joints stay within `swings`.
    pub fn curve_bound(&self, capsule: usize, swings: &[Swing; JOINTS_MAX]) -> (f64, f64) {
        let (mut curve, mut path) = ([0.0; JOINTS_MAX + 1], [0.0; JOINTS_MAX + 1]);
        self.shapes[capsule].curves(&self.chain, swings, &mut curve, &mut path);
        (curve[0], path[0])
    }

    /// Number of pairs.
    pub fn pair_count(&self) -> usize {
        self.pairs.len()
    }

    /// Capsule indices of pair `i`. For an obstacle the second is the number of capsules plus its index.
    pub fn pair(&self, i: usize) -> [usize; 2] {
        [self.pairs[i].a.capsule, self.pairs[i].b.capsule]
    }

    /// The axis of capsule `i` in the base frame.
    #[inline]
    pub(crate) fn axis(&self, i: usize, placements: &Placements) -> Segment {
        let c = &self.shapes[i].capsule;
        let body = &placements[c.body];
        Segment { a: body.point(&c.a), b: body.point(&c.b) }
    }

    /// The closest points of a pair whose axes are `a` and `b`. For an obstacle `b` is not used.
    #[inline]
    pub(crate) fn closest_points(&self, pair: &CheckedPair, a: &Segment, b: &Segment) -> (Vector3<f64>, Vector3<f64>) {
        pair.obstacle.map_or_else(|| closest_points(a, b), |k| solid::closest_points(a, &self.obstacles[k]))
    }

    /// The unit direction from the closest point of B to that of A, and the separation of the surfaces along it, m.
    #[inline]
    pub(crate) fn normal(&self, pair: &CheckedPair, a: &Segment, b: &Segment) -> (Vector3<f64>, f64) {
        let (n, sep) = pair.obstacle.map_or_else(|| normal(a, b), |k| solid::normal(a, &self.obstacles[k]));
        (n, sep - pair.radii)
    }

    /// The separation of the surfaces of a pair along `n`, m.
    #[inline]
    pub(crate) fn separation(&self, pair: &CheckedPair, n: &Vector3<f64>, a: &Segment, b: &Segment) -> f64 {
        let axes = pair.obstacle.map_or_else(|| separation(n, a, b), |k| solid::separation(n, a, &self.obstacles[k]));
        axes - pair.radii
    }
}

#[inline]
fn change_m([a, b]: [u16; 2], rows: &Rows) -> f64 {
    rows[usize::from(a)] + rows[usize::from(b)]
}

/// Creates an entry in the list of shapes for an obstacle.
fn obstacle(solid: &Solid) -> Shape {
    let center = match solid {
        Solid::HalfSpace { normal, offset_m } => normal * *offset_m,
        Solid::Box { center, .. } => *center,
    };
    let capsule = BodyCapsule { body: 0, a: center, b: center, radius_m: 0.0 };
    Shape { capsule, chain: Vec::new(), reach: Vec::new() }
}

fn shape(chain: &KinematicChain, capsule: BodyCapsule) -> Shape {
    let joints: Vec<usize> = joints(chain.ancestors(capsule.body)).collect();
    // A norm is convex, so its largest value along the axis is at an end.
    let farthest = |j: usize| chain.reach(j, capsule.body, &capsule.a).max(chain.reach(j, capsule.body, &capsule.b));
    let reach = joints.iter().map(|&j| farthest(j)).collect();
    Shape { capsule, chain: joints, reach }
}

fn checked_pair(chain: &KinematicChain, shapes: &[Shape], a: usize, b: usize) -> CheckedPair {
    let (body_a, body_b) = (shapes[a].capsule.body, shapes[b].capsule.body);
    let (set_a, set_b) = (chain.ancestors(body_a), chain.ancestors(body_b));
    let shared = set_a & set_b;
    let common = chain.common_body(body_a, body_b);
    let side = |capsule: usize| Side { capsule, from: shared.count_ones() as usize };
    let turns = joints(shared).any(|j| !chain.links()[j].prismatic);
    CheckedPair {
        a: side(a),
        b: side(b),
        obstacle: None,
        radii: shapes[a].capsule.radius_m + shapes[b].capsule.radius_m,
        common,
        turns,
        between: set_a ^ set_b,
        needed: set_a | set_b,
    }
}

/// The points of two segments that are closest to each other. The work is bounded, and nothing is allocated. Near
/// parallel axes the points may be off the optimum. So callers use the direction between them and never their distance.
#[inline]
pub(crate) fn closest_points(p: &Segment, q: &Segment) -> (Vector3<f64>, Vector3<f64>) {
    let (d1, d2, r) = (p.b - p.a, q.b - q.a, p.a - q.a);
    let (a, e, f) = (d1.norm_squared(), d2.norm_squared(), d2.dot(&r));
    // An axis this short is a point. Below a nanometre its direction means nothing.
    const POINT: f64 = 1e-18;
    let (s, t) = if a <= POINT {
        (0.0, if e <= POINT { 0.0 } else { (f / e).clamp(0.0, 1.0) })
    } else {
        let c = d1.dot(&r);
        if e <= POINT {
            ((-c / a).clamp(0.0, 1.0), 0.0)
        } else {
            let b = d1.dot(&d2);
            let denominator = a * e - b * b;
            let s = if denominator > 0.0 { ((b * f - c * e) / denominator).clamp(0.0, 1.0) } else { 0.0 };
            let t = (b * s + f) / e;
            if t < 0.0 {
                ((-c / a).clamp(0.0, 1.0), 0.0)
            } else if t > 1.0 {
                (((b - c) / a).clamp(0.0, 1.0), 1.0)
            } else {
                (s, t)
            }
        }
    };
    (p.a + d1 * s, q.a + d2 * t)
}

/// Separation of two axes along `n` (from B to A): min over A of n.x minus max over B of n.x.
#[inline]
pub(crate) fn separation(n: &Vector3<f64>, a: &Segment, b: &Segment) -> f64 {
    n.dot(&a.a).min(n.dot(&a.b)) - n.dot(&b.a).max(n.dot(&b.b))
}

/// The unit direction from the closest point of B to that of A, and the separation along it. The separation
/// is at most the distance.
#[inline]
pub(crate) fn normal(a: &Segment, b: &Segment) -> (Vector3<f64>, f64) {
    let (x, y) = closest_points(a, b);
    let difference = x - y;
    let length = difference.norm();
    if length < 1e-12 {
        return (Vector3::x(), 0.0);
    }
    let n = difference / length;
    (n, separation(&n, a, b))
}
