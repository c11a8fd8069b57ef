//! Proves that two capsules cannot meet anywhere in the box of the position limits, or finds where they do.

use nalgebra::Vector3;
use rand::{RngExt, SeedableRng};
use robot::{Capsule, Frames, Model, segment_distance};

/// What is known of a pair over all joint positions within the URDF's limits.
#[derive(Clone, Debug, PartialEq)]
pub enum Verdict {
    /// Never closer than this, m: proved for every configuration.
    Clear {
        /// The bound, m.
        at_least_m: f64,
    },
    /// Closer than the bound in a configuration that was found.
    Meets {
        /// The clearance there, m.
        clearance_m: f64,
    },
    /// Neither proved nor refuted within the effort allowed.
    Open,
}

/// Random configurations tried before a proof is tried.
const SAMPLES: usize = 3_000;
/// Cells of the joint box that a proof may visit.
const CELLS_MAX: usize = 400_000;

/// Joints that move `body` against the base, from the base outward.
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

/// Joints whose positions decide how two bodies lie to each other.
pub fn deciding_joints(model: &Model, a: usize, b: usize) -> (Vec<usize>, Vec<usize>) {
    let (mut a, mut b) = (chain(model, a), chain(model, b));
    let common = a.iter().zip(&b).take_while(|(x, y)| x == y).count();
    (a.split_off(common), b.split_off(common))
}

/// The clearance of two capsules in a configuration, m.
pub fn clearance(frames: &Frames, a: &Capsule, b: &Capsule) -> f64 {
    let ends = |capsule: &Capsule| {
        let pose = &frames.base_from_body[capsule.body];
        (pose.transform_point(&capsule.a), pose.transform_point(&capsule.b))
    };
    let ((a0, a1), (b0, b1)) = (ends(a), ends(b));
    segment_distance(&a0, &a1, &b0, &b1).distance_m - a.radius_m - b.radius_m
}

/// How far a capsule's axis can move against the common ancestor when its joints leave the middle of a cell by at most
/// their half widths, m.
///
/// From the far end inward: turning joint j by h moves a point at distance p from its axis by at most h p; the joints
/// beyond j may have moved it by D before, so p grows by D. A sliding joint adds h.
fn drift(model: &Model, frames: &Frames, joints: &[usize], half: &[f64], capsule: &Capsule) -> f64 {
    let pose = &frames.base_from_body[capsule.body];
    let ends = [pose.transform_point(&capsule.a), pose.transform_point(&capsule.b)];
    let mut moved = 0.0;
    for (j, half) in joints.iter().zip(half).rev() {
        let body = &frames.base_from_body[j + 1];
        let axis: Vector3<f64> = body.r * model.joint_at_zero(*j).1;
        let far = ends
            .iter()
            .map(|end| axis.cross(&(end - body.t)).norm())
            .fold(0.0, f64::max);
        moved += if model.prismatic[*j] {
            *half
        } else {
            half * (far + moved)
        };
    }
    moved
}

/// Decides about one pair: is it always farther apart than `clear_m`?
pub fn prove(model: &Model, a: &Capsule, b: &Capsule, clear_m: f64) -> Verdict {
    let (of_a, of_b) = deciding_joints(model, a.body, b.body);
    let joints: Vec<usize> = of_a.iter().chain(&of_b).copied().collect();
    let limits = |j: usize| (model.urdf_limits[j].q_min, model.urdf_limits[j].q_max);
    let mut frames = Frames::default();
    let mut rng = rand_pcg::Pcg64::seed_from_u64(1);
    let mut q = model.home;
    for _ in 0..SAMPLES {
        for j in &joints {
            q[*j] = rng.random_range(limits(*j).0..limits(*j).1);
        }
        model.forward(&q, &mut frames);
        let clearance_m = clearance(&frames, a, b);
        if clearance_m <= clear_m {
            return Verdict::Meets { clearance_m };
        }
    }
    let whole: Vec<(f64, f64)> = joints.iter().map(|j| limits(*j)).collect();
    let mut open = vec![whole];
    let mut least = f64::INFINITY;
    for _ in 0..CELLS_MAX {
        let Some(cell) = open.pop() else {
            return Verdict::Clear { at_least_m: least };
        };
        let half: Vec<f64> = cell.iter().map(|(low, high)| 0.5 * (high - low)).collect();
        for (j, (low, high)) in joints.iter().zip(&cell) {
            q[*j] = 0.5 * (low + high);
        }
        model.forward(&q, &mut frames);
        let middle = clearance(&frames, a, b);
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
            let capsule = if i < of_a.len() { a } else { b };
            drift(model, &frames, &joints[i..=i], &half[i..=i], capsule)
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
