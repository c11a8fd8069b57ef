//! Finds the direction into the nearest collision, for the attacker.

use messages::JOINTS_MAX;
use nalgebra::Vector3;
use robot::{Frames, Model, segment_distance};

/// Number of nearest pairs that are kept apart by rank.
pub(crate) const RANKS: usize = 4;

/// Step of the difference quotient, rad or m.
const STEP: f64 = 1e-6;

/// Returns the derivative by each joint of the distance of the `rank`-th nearest (0: the nearest) of the checked pairs
/// at posture `q`, m per rad or m.
///
/// d = |p_b - p_a| - r_a - r_b and dd/dq = n . (J_b - J_a). Here n is the unit vector from a to b, and J are
/// the Jacobians of the nearest points.
pub(crate) fn of_pair(model: &Model, q: &[f64; JOINTS_MAX], rank: usize) -> Option<[f64; JOINTS_MAX]> {
    let mut frames = Frames::default();
    model.forward(q, &mut frames);
    let end = |body: usize, p: &Vector3<f64>| frames.base_from_body[body].transform_point(p);
    let ends: Vec<_> = model.capsules.iter().map(|c| [end(c.body, &c.a), end(c.body, &c.b)]).collect();
    let mut least = [(f64::INFINITY, usize::MAX); RANKS];
    for (index, pair) in model.pairs.iter().enumerate() {
        let ([a0, a1], [b0, b1]) = (&ends[pair.a], &ends[pair.b]);
        let radii = model.capsules[pair.a].radius_m + model.capsules[pair.b].radius_m;
        let clearance_m = segment_distance(a0, a1, b0, b1).distance_m - radii;
        if let Some(place) = least.iter().position(|(other, _)| clearance_m < *other) {
            least[place..].rotate_right(1);
            least[place] = (clearance_m, index);
        }
    }
    let pair = model.pairs.get(least[rank.min(RANKS - 1)].1)?;
    let ([a0, a1], [b0, b1]) = (&ends[pair.a], &ends[pair.b]);
    let found = segment_distance(a0, a1, b0, b1);
    let (on_a, on_b) = (a0 + (a1 - a0) * found.s, b0 + (b1 - b0) * found.t);
    let n = (on_b - on_a).try_normalize(0.0)?;
    let columns_a = model.jacobian(&frames, model.capsules[pair.a].body, &on_a);
    let columns_b = model.jacobian(&frames, model.capsules[pair.b].body, &on_b);
    let along = |column: &[f64; 6]| n.x * column[0] + n.y * column[1] + n.z * column[2];
    Some(std::array::from_fn(|j| along(&columns_b[j]) - along(&columns_a[j])))
}

/// Returns the derivative of the least distance from an obstacle. None without obstacles.
pub(crate) fn of_obstacle(model: &Model, q: &[f64; JOINTS_MAX]) -> Option<[f64; JOINTS_MAX]> {
    let mut frames = Frames::default();
    let clearance_at = |q: &[f64; JOINTS_MAX]| {
        model.forward(q, &mut frames);
        model.obstacle_clearance(&frames).0
    };
    (!model.obstacles.is_empty()).then(|| quotient(q, clearance_at))
}

/// Returns the derivative of `of` as a difference quotient.
pub(crate) fn quotient(q: &[f64; JOINTS_MAX], mut of: impl FnMut(&[f64; JOINTS_MAX]) -> f64) -> [f64; JOINTS_MAX] {
    let here = of(q);
    std::array::from_fn(|j| {
        let mut beside = *q;
        beside[j] += STEP;
        (of(&beside) - here) / STEP
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Robot;

    #[test]
    fn clearance_gradient_matches_the_difference_quotient() {
        let robot = Robot::load(concat!(env!("CARGO_MANIFEST_DIR"), "/../../config/robots/tiago_dual.toml"));
        let gradient = of_pair(robot.model().unwrap(), &robot.home, 0).unwrap();
        for (j, of_joint) in gradient.into_iter().enumerate() {
            let at = |by: f64| {
                let mut q = robot.home;
                q[j] += by;
                robot.clearance(&q)
            };
            let quotient = (at(1e-6) - at(-1e-6)) / 2e-6;
            assert!((quotient - of_joint).abs() < 1e-5, "joint {j}: {quotient} {of_joint}");
        }
    }
}
