//! Finds the direction into the nearest collision.

use messages::JOINTS;
use nalgebra::Vector3;
use robot::{CAPSULES_MAX, Frames, Model, segment_distance};

/// Number of nearest pairs that are kept apart by rank.
pub const RANKS: usize = 4;

/// A pair, and the derivative of its distance by the joints.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Nearest {
    /// Clearance of the pair, m.
    pub clearance_m: f64,
    /// Its derivative by each joint, m per rad or m.
    pub gradient: [f64; JOINTS],
}

/// Returns the `rank`-th nearest (0: the nearest) of the checked pairs at posture `q`, rad or m. `frames` is
/// working memory.
///
/// d = |p_b - p_a| - r_a - r_b and dd/dq = n . (J_b - J_a). Here n is the unit vector from a to b, and J are
/// the Jacobians of the nearest points.
pub fn nearest(model: &Model, frames: &mut Frames, q: &[f64; JOINTS], rank: usize) -> Option<Nearest> {
    model.forward(q, frames);
    let mut ends = [[Vector3::zeros(); 2]; CAPSULES_MAX];
    for (end, capsule) in ends.iter_mut().zip(&model.capsules) {
        let pose = &frames.base_from_body[capsule.body];
        *end = [pose.transform_point(&capsule.a), pose.transform_point(&capsule.b)];
    }
    let mut least = [(f64::INFINITY, usize::MAX); RANKS];
    for (index, pair) in model.pairs.iter().enumerate() {
        let ([a0, a1], [b0, b1]) = (&ends[pair.a], &ends[pair.b]);
        let radii = model.capsules[pair.a].radius_m + model.capsules[pair.b].radius_m;
        let clearance_m = segment_distance(a0, a1, b0, b1).distance_m - radii;
        let place = least.iter().position(|(other, _)| clearance_m < *other);
        if let Some(place) = place {
            least[place..].rotate_right(1);
            least[place] = (clearance_m, index);
        }
    }
    let (clearance_m, index) = least[rank.min(RANKS - 1)];
    let pair = model.pairs.get(index)?;
    let ([a0, a1], [b0, b1]) = (&ends[pair.a], &ends[pair.b]);
    let found = segment_distance(a0, a1, b0, b1);
    let (on_a, on_b) = (a0 + (a1 - a0) * found.s, b0 + (b1 - b0) * found.t);
    let n = (on_b - on_a).try_normalize(0.0)?;
    let columns_a = model.jacobian(frames, model.capsules[pair.a].body, &on_a);
    let columns_b = model.jacobian(frames, model.capsules[pair.b].body, &on_b);
    let along = |column: &[f64; 6]| n.x * column[0] + n.y * column[1] + n.z * column[2];
    let gradient = std::array::from_fn(|j| along(&columns_b[j]) - along(&columns_a[j]));
    Some(Nearest { clearance_m, gradient })
}

/// Step of the difference quotient, rad or m.
const STEP: f64 = 1e-6;

/// Returns the body that is nearest to an obstacle at posture `q`, with the derivative as a difference
/// quotient. None without obstacles.
pub fn nearest_obstacle(model: &Model, frames: &mut Frames, q: &[f64; JOINTS]) -> Option<Nearest> {
    if model.obstacles.is_empty() {
        return None;
    }
    let mut clearance_at = |q: &[f64; JOINTS]| {
        model.forward(q, frames);
        model.obstacle_clearance(frames).0
    };
    let clearance_m = clearance_at(q);
    let gradient = std::array::from_fn(|j| {
        let mut beside = *q;
        beside[j] += STEP;
        (clearance_at(&beside) - clearance_m) / STEP
    });
    Some(Nearest { clearance_m, gradient })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn clearance_gradient_matches_the_difference_quotient() {
        let file = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/robots/tiago_dual.toml");
        let (model, _) = config::load_model(&file).unwrap();
        let mut frames = Frames::default();
        let home = nearest(&model, &mut frames, &model.home, 0).unwrap();
        let (least, _) = model.clearance(&frames);
        assert!((home.clearance_m - least).abs() < 1e-12);
        for j in 0..JOINTS {
            let at = |by: f64| {
                let mut q = model.home;
                q[j] += by;
                nearest(&model, &mut Frames::default(), &q, 0).unwrap().clearance_m
            };
            let quotient = (at(1e-6) - at(-1e-6)) / 2e-6;
            assert!((quotient - home.gradient[j]).abs() < 1e-5, "joint {j}: {quotient} {}", home.gradient[j]);
        }
    }
}
