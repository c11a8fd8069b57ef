//! Proves that two capsules cannot meet anywhere in the box of the position limits, or finds where they do.

use nalgebra::Vector3;
use rand::{RngExt, SeedableRng};
use robot::{Capsule, Frames, Model, segment_distance};

/// Result for a pair over all joint positions within the limits in force. No command leaves these limits.
#[derive(Clone, Debug, PartialEq)]
pub enum Verdict {
    /// Never closer than this, m. It is proved for every configuration.
    Clear {
        at_least_m: f64,
    },
    /// Closer than the bound in a configuration that was found.
    Meets {
        clearance_m: f64,
    },
    Open,
}

/// Random configurations per deciding joint before a proof is tried. They are cheap where many joints make
/// proofs expensive.
const SAMPLES_PER_JOINT: usize = 20;
/// Largest number of cells of the joint box that a proof may visit.
pub const CELLS_MAX: usize = 200_000;

/// Returns the joints that move `body` relative to the base, from the base outward.
fn chain(model: &Model, body: usize) -> Vec<usize> {
    let mut joints = Vec::new();
    let mut at = body;
    while let Some(parent) = model.parent_body(at) {
        joints.push(at - 1);
        at = parent;
    }
    joints.reverse();
    joints
}

/// Returns the joints that determine the relative pose of two bodies.
pub fn deciding_joints(model: &Model, a: usize, b: usize) -> (Vec<usize>, Vec<usize>) {
    let (mut a, mut b) = (chain(model, a), chain(model, b));
    let common = a.iter().zip(&b).take_while(|(x, y)| x == y).count();
    (a.split_off(common), b.split_off(common))
}

pub fn clearance(frames: &Frames, a: &Capsule, b: &Capsule) -> f64 {
    let ([a0, a1], [b0, b1]) = (a.ends(frames), b.ends(frames));
    segment_distance(&a0, &a1, &b0, &b1).distance_m - a.radius_m - b.radius_m
}

/// Returns how far points of a body can move relative to the common ancestor, m. Its joints leave the middle of
/// a cell by at most their half widths.
///
/// It goes from the far end inward. Turning joint j by h moves a point at distance p from its axis by at most h
/// p. The joints beyond j may have moved it by D before, so p grows by D. A prismatic joint adds h. The
/// distance from an axis is convex, so the bound for the points holds for their convex hull.
fn drift(model: &Model, frames: &Frames, joints: &[usize], half: &[f64], part: &Part<'_>) -> f64 {
    let pose = &frames.base_from_body[part.body];
    let points: Vec<Vector3<f64>> = part.points.iter().map(|point| pose.transform_point(point)).collect();
    let mut moved = 0.0;
    for (j, half) in joints.iter().zip(half).rev() {
        let body = &frames.base_from_body[j + 1];
        let axis: Vector3<f64> = body.r * model.joint_at_zero(*j).1;
        let far = points.iter().map(|point| axis.cross(&(point - body.t)).norm()).fold(0.0, f64::max);
        moved += if model.prismatic[*j] { *half } else { half * (far + moved) };
    }
    moved
}

/// A moving part: the convex hull of points of a body.
#[derive(Clone, Copy)]
pub struct Part<'a> {
    pub body: usize,
    /// Points in the body's frame, m.
    pub points: &'a [Vector3<f64>],
}

/// Decides whether two capsules are always farther apart than `clear_m`.
pub fn prove(model: &Model, a: &Capsule, b: &Capsule, clear_m: f64) -> Verdict {
    let (of_a, of_b) = ([a.a, a.b], [b.a, b.b]);
    let (a_part, b_part) = (Part { body: a.body, points: &of_a }, Part { body: b.body, points: &of_b });
    prove_parts(model, &a_part, &b_part, clear_m, CELLS_MAX, &|frames| clearance(frames, a, b))
}

/// Decides whether the clearance of two parts is always above `clear_m`. `distance` returns the clearance (m)
/// in a configuration. The proof visits at most `cells_max` cells.
///
/// Branch and bound over the box of the limits in force. A cell is done if the clearance in its middle is
/// enough, less all that both parts can move inside the cell. Otherwise the cell is halved across the joint
/// that moves them most.
pub fn prove_parts(
    model: &Model,
    a: &Part<'_>,
    b: &Part<'_>,
    clear_m: f64,
    cells_max: usize,
    distance: &dyn Fn(&Frames) -> f64,
) -> Verdict {
    let (of_a, of_b) = deciding_joints(model, a.body, b.body);
    let joints: Vec<usize> = of_a.iter().chain(&of_b).copied().collect();
    let limits = |j: usize| (model.limits[j].q_min, model.limits[j].q_max);
    let mut frames = Frames::default();
    let mut rng = rand_pcg::Pcg64::seed_from_u64(1);
    let mut q = model.home;
    for _ in 0..SAMPLES_PER_JOINT * joints.len() * joints.len() {
        for j in &joints {
            q[*j] = rng.random_range(limits(*j).0..limits(*j).1);
        }
        model.forward(&q, &mut frames);
        let clearance_m = distance(&frames);
        if clearance_m <= clear_m {
            return Verdict::Meets { clearance_m };
        }
    }
    let mut open: Vec<Vec<(f64, f64)>> = vec![joints.iter().map(|j| limits(*j)).collect()];
    let mut least = f64::INFINITY;
    for _ in 0..cells_max {
        let Some(cell) = open.pop() else {
            return Verdict::Clear { at_least_m: least };
        };
        let half: Vec<f64> = cell.iter().map(|(low, high)| 0.5 * (high - low)).collect();
        for (j, (low, high)) in joints.iter().zip(&cell) {
            q[*j] = 0.5 * (low + high);
        }
        model.forward(&q, &mut frames);
        let middle = distance(&frames);
        if middle <= clear_m {
            return Verdict::Meets { clearance_m: middle };
        }
        let (half_a, half_b) = half.split_at(of_a.len());
        let bound = middle - drift(model, &frames, &of_a, half_a, a) - drift(model, &frames, &of_b, half_b, b);
        if bound > clear_m {
            least = least.min(bound);
            continue;
        }
        let widest = |i: usize| {
            let part = if i < of_a.len() { a } else { b };
            drift(model, &frames, &joints[i..=i], &half[i..=i], part)
        };
        let Some(at) = (0..joints.len()).max_by(|x, y| widest(*x).total_cmp(&widest(*y))) else {
            return Verdict::Open;
        };
        let (low, high) = cell[at];
        for range in [(low, 0.5 * (low + high)), (0.5 * (low + high), high)] {
            let mut part = cell.clone();
            part[at] = range;
            open.push(part);
        }
    }
    Verdict::Open
}
