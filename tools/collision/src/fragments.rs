//! Shapes as trees of small convex hulls: nearly as tight as the surface, and much faster to measure.

use crate::mesh::Points;
use crate::split::Matter;
use nalgebra::Vector3;
use robot::{Hull, Pose};

/// Contents are cut until a fragment is one polygon, or none of its sides is longer than this, m (chosen).
const SIDE_M: f64 = 0.004;
/// A flat fragment is made this thick, m. Its hull would have no volume.
const THICK_M: f64 = 1e-4;
/// A distance that need not be known is at least this much more than enough, m (chosen).
const ENOUGH_M: f64 = 1e-3;

/// The fragments of a capsule's contents, in one frame. The first node contains all others.
pub struct Fragments(Vec<Node>);

struct Node {
    center: Vector3<f64>,
    radius_m: f64,
    inside: Inside,
}

enum Inside {
    Fragment(Box<Hull>),
    Nodes([usize; 2]),
}

impl Fragments {
    /// Cuts contents into fragments. `None` if there are no contents, or if a hull fails.
    pub fn new(matter: &Matter) -> Option<Self> {
        let mut nodes = Self(Vec::new());
        nodes.add(matter)?;
        Some(nodes)
    }

    /// Adds the fragments of these contents. Returns their node.
    fn add(&mut self, matter: &Matter) -> Option<usize> {
        let points = matter.points();
        let first = points.first()?;
        let low = points.iter().fold(*first, |low, point| low.inf(point));
        let high = points.iter().fold(*first, |high, point| high.sup(point));
        let (side, center) = (high - low, (low + high) * 0.5);
        let radius_m = points.iter().map(|point| (point - center).norm()).fold(0.0, f64::max) + THICK_M;
        let node = self.0.len();
        let single = matter.surface.len() + matter.pieces.len() == 1;
        if side.max() <= SIDE_M || single {
            let inside = Inside::Fragment(Box::new(hull(&points)?));
            self.0.push(Node { center, radius_m, inside });
            return Some(node);
        }
        self.0.push(Node { center, radius_m, inside: Inside::Nodes([node, node]) });
        let normal = Vector3::ith(side.imax(), 1.0);
        // Pieces are not cut, so a large one beside a surface would never get smaller: they are parted first.
        let mixed = !matter.surface.is_empty() && !matter.pieces.is_empty();
        let [mut below, mut above] = if mixed {
            let surface = Matter { surface: matter.surface.clone(), pieces: Vec::new() };
            [surface, Matter { surface: Vec::new(), pieces: matter.pieces.clone() }]
        } else {
            matter.cut(&normal, normal.dot(&center))
        };
        if below.points().is_empty() || above.points().is_empty() {
            // Pieces whose middles are on one side. They are not cut, so they are parted by number.
            let mut all = if below.points().is_empty() { above } else { below };
            let rest = all.pieces.split_off(all.pieces.len() / 2);
            let part = Matter { surface: Vec::new(), pieces: rest };
            (below, above) = (all, part);
        }
        let children = [self.add(&below)?, self.add(&above)?];
        self.0[node].inside = Inside::Nodes(children);
        Some(node)
    }

    /// Returns the distance of two sets of fragments, m. The bounds are those of [`Distance`](crate::prove::Distance).
    pub fn distance_m(&self, pose: &Pose, other: &Self, other_pose: &Pose, [least_m, enough_m]: [f64; 2]) -> f64 {
        let a_from_b = pose.inverse().compose(other_pose);
        let between_m = if least_m.is_finite() { enough_m } else { f64::NEG_INFINITY };
        let pair = Pair { a: self, b: other, a_from_b, least_m: least_m.max(0.0), between_m };
        pair.least(0, 0, enough_m + ENOUGH_M)
    }
}

/// Two sets of fragments, and how the second lies to the first.
struct Pair<'a> {
    a: &'a Fragments,
    b: &'a Fragments,
    a_from_b: Pose,
    /// Up to this, the distance need not be known, m.
    least_m: f64,
    /// Up to this, only distances up to the least count, m.
    between_m: f64,
}

impl Pair<'_> {
    /// Spheres bound the distance of two nodes from below.
    fn bound(&self, a: usize, b: usize) -> f64 {
        let (a, b) = (&self.a.0[a], &self.b.0[b]);
        (a.center - self.a_from_b.transform_point(&b.center)).norm() - a.radius_m - b.radius_m
    }

    /// Returns the distance of two nodes, or `best` if that is less.
    fn least(&self, a: usize, b: usize, best: f64) -> f64 {
        let (node_a, node_b) = (&self.a.0[a], &self.b.0[b]);
        let pairs = match (&node_a.inside, &node_b.inside) {
            (Inside::Fragment(hull_a), Inside::Fragment(hull_b)) => {
                return best.min(hull_a.distance_m(&Pose::identity(), hull_b, &self.a_from_b));
            }
            (Inside::Nodes(of_a), Inside::Nodes(_)) if node_a.radius_m >= node_b.radius_m => of_a.map(|a| (a, b)),
            (Inside::Nodes(of_a), Inside::Fragment(_)) => of_a.map(|a| (a, b)),
            (_, Inside::Nodes(of_b)) => of_b.map(|b| (a, b)),
        };
        let mut bounds = pairs.map(|(a, b)| (self.bound(a, b), a, b));
        if bounds[1].0 < bounds[0].0 {
            bounds.swap(0, 1);
        }
        let nearer = |best: f64, (bound, a, b): &(f64, usize, usize)| {
            let counts = if best > self.between_m { *bound < best } else { *bound <= self.least_m };
            if counts && best > self.least_m { self.least(*a, *b, best) } else { best }
        };
        bounds.iter().fold(best, nearer)
    }
}

/// Returns the convex hull of points. Flat ones are made thick.
fn hull(points: &Points) -> Option<Hull> {
    let thick = || {
        let shifts = [Vector3::x(), Vector3::y(), Vector3::z()].map(|axis| axis * (0.5 * THICK_M));
        let around = |point: &Vector3<f64>| shifts.iter().flat_map(|s| [point + s, point - s]).collect::<Points>();
        Hull::new(&points.iter().flat_map(around).collect::<Points>())
    };
    Hull::new(points).or_else(thick)
}
