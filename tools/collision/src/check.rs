//! Checks that capsules contain meshes and primitives, and checks the reasons of all pairs that are not checked
//! at run time.

use crate::fit::Shape;
use crate::judge::{Judge, Proof};
use crate::mesh::Points;
use crate::split::Matter;
use crate::write::Named;
use nalgebra::Vector3;
use rand::{RngExt, SeedableRng};
use robot::{AllowedReason, Frames, Model};

/// Edge length down to which a surface is halved before it counts as not contained, m.
const EDGE_MIN_M: f64 = 5e-4;
/// Distance that a vertex may stick out because of rounding of the file's decimals, m.
const ROUNDING_M: f64 = 1e-9;

/// Returns how far the worst point of the matter sticks out of all capsules, m. Zero or negative means that all
/// is contained.
pub fn sticks_out_m(matter: &Matter, capsules: &[Shape]) -> f64 {
    worst_point(matter, capsules).map_or(f64::NEG_INFINITY, |(out_m, _)| out_m)
}

/// Returns the point of the matter that sticks out of all capsules the most, and how far, m. Zero or negative means
/// that all is contained. `None` without matter.
///
/// The test covers more than vertices. A polygon is contained if its corners lie in one capsule, because
/// capsules are convex. Otherwise it is halved until that is true, or until it is too small.
pub fn worst_point(matter: &Matter, capsules: &[Shape]) -> Option<(f64, Vector3<f64>)> {
    let mut worst: Option<(f64, Vector3<f64>)> = None;
    let mut note = |out_m: f64, point: Vector3<f64>| {
        if worst.is_none_or(|(most_m, _)| out_m > most_m) {
            worst = Some((out_m, point));
        }
    };
    let farthest = |(out_m, point): (f64, Vector3<f64>), other: (f64, Vector3<f64>)| {
        if other.0 > out_m { other } else { (out_m, point) }
    };
    for piece in &matter.pieces {
        let fits = |shape: &Shape| piece.iter().map(|point| (shape.outside_m(point), *point)).reduce(farthest);
        let best = capsules.iter().filter_map(fits).min_by(|a, b| a.0.total_cmp(&b.0));
        let none = piece.first().map(|point| (f64::INFINITY, *point));
        best.or(none).into_iter().for_each(|(out_m, point)| note(out_m, point));
    }
    let mut open: Vec<Points> = matter.surface.clone();
    while let Some(polygon) = open.pop() {
        let [first, rest @ ..] = polygon.as_slice() else {
            continue;
        };
        if rest.len() > 2 {
            open.extend(rest.windows(2).map(|edge| vec![*first, edge[0], edge[1]]));
            continue;
        }
        let reach = |point: &Vector3<f64>| capsules.iter().map(|c| c.outside_m(point)).fold(f64::INFINITY, f64::min);
        let (out, point) =
            polygon.iter().map(|point| (reach(point), *point)).fold((f64::NEG_INFINITY, *first), farthest);
        note(out, point);
        let inside = |shape: &Shape| polygon.iter().all(|point| shape.outside_m(point) <= ROUNDING_M);
        if out > ROUNDING_M || capsules.iter().any(inside) {
            continue;
        }
        let edge = |i: usize| (polygon[(i + 1) % polygon.len()] - polygon[i]).norm();
        let longest = (0..polygon.len()).max_by(|a, b| edge(*a).total_cmp(&edge(*b))).unwrap_or(0);
        if edge(longest) < EDGE_MIN_M {
            note(EDGE_MIN_M, point);
            continue;
        }
        let (p, next) = (polygon[longest], polygon[(longest + 1) % polygon.len()]);
        let other = polygon[(longest + 2) % polygon.len()];
        let middle = (p + next) * 0.5;
        open.push(vec![p, middle, other]);
        open.push(vec![middle, next, other]);
    }
    worst
}

/// Returns the capsules of a model that lie on the body of `link`, in the frame of that link.
pub fn capsules_in_frame(model: &Model, link: &str, names: impl Fn(&str) -> bool) -> Vec<Shape> {
    let Some((body, body_from_link)) = model.link_body(link) else {
        return Vec::new();
    };
    let link_from_body = body_from_link.inverse();
    let own = model.capsules.iter().filter(|capsule| capsule.body == body && names(&capsule.name));
    own.map(|capsule| Shape {
        a: link_from_body.transform_point(&capsule.a),
        b: link_from_body.transform_point(&capsule.b),
        radius_m: capsule.radius_m,
    })
    .collect()
}

/// Returns the distance of each fitted capsule from the model's capsule of the same name, m. It is the larger
/// of the distances of its ends and of the difference of the radii. It is infinite if the model has no such
/// capsule, or has it on another body.
pub fn deviations_m(model: &Model, fitted: &[Named]) -> Vec<(String, f64)> {
    let of = |named: &Named| {
        let same = |capsule: &&robot::Capsule| capsule.name == named.name;
        let (Some(capsule), Some((body, pose))) = (model.capsules.iter().find(same), model.link_body(&named.link))
        else {
            return f64::INFINITY;
        };
        if capsule.body != body {
            return f64::INFINITY;
        }
        let end = |fitted: &Vector3<f64>, known: &Vector3<f64>| (pose.transform_point(fitted) - known).norm();
        let ends = end(&named.shape.a, &capsule.a).max(end(&named.shape.b, &capsule.b));
        ends.max((named.shape.radius_m - capsule.radius_m).abs())
    };
    fitted.iter().map(|named| (named.name.clone(), of(named))).collect()
}

#[derive(Clone, Debug)]
pub struct Reason {
    pub names: (String, String),
    pub reason: AllowedReason,
    pub proof: Option<Proof>,
    /// Proved to overlap everywhere.
    pub overlaps: bool,
}

impl Reason {
    pub fn holds(&self) -> bool {
        match self.reason {
            AllowedReason::SameBody | AllowedReason::Adjacent => true,
            AllowedReason::ProvedClear => self.proof.is_some(),
            AllowedReason::OverlapAsPublished => self.overlaps,
        }
    }
}

/// Proves again every pair that the robot file calls clear.
pub fn reasons(model: &Model, judge: &Judge<'_>, names: &[String]) -> Vec<Reason> {
    let index = |name: &String| names.iter().position(|known| known == name);
    let reason = |pair: &robot::AllowedPair| {
        let (a, b) = (model.capsules[pair.a].name.clone(), model.capsules[pair.b].name.clone());
        let proof = match (pair.reason, index(&a), index(&b)) {
            (AllowedReason::ProvedClear, Some(first), Some(second)) => judge.prove(first, second),
            _ => None,
        };
        let overlaps = match (pair.reason, index(&a), index(&b)) {
            (AllowedReason::OverlapAsPublished, Some(first), Some(second)) => judge.prove_overlap(first, second),
            _ => false,
        };
        Reason { names: (a, b), reason: pair.reason, proof, overlaps }
    };
    model.allowed.iter().map(reason).collect()
}

/// Returns the share of configurations, uniform in the URDF's limits, in which a checked pair overlaps.
pub fn collision_share(model: &Model, samples: usize) -> f64 {
    let mut rng = rand_pcg::Pcg64::seed_from_u64(2);
    let mut frames = Frames::default();
    let mut colliding = 0;
    for _ in 0..samples {
        let q = std::array::from_fn(|j| {
            let limits = &model.urdf_limits[j];
            rng.random_range(limits.q_min..limits.q_max)
        });
        model.forward(&q, &mut frames);
        colliding += usize::from(model.clearance(&frames).0 < 0.0);
    }
    colliding as f64 / samples as f64
}
