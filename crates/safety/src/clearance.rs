//! Distances of the capsule model. This implementation shares no code with whole-body control or `robot`.

use messages::JOINTS_MAX;
use nalgebra::Vector3;
use robot::{CAPSULES_MAX, Capsule, Frames, Model, Solid};

/// The least distance over the checked pairs, and over all pairs of a moving capsule and an obstacle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Clearance {
    /// Distance from surface to surface, m. It is negative where capsules overlap, and NaN if a position is not finite.
    pub distance_m: f64,
    /// Indices of the two capsules in the robot file. For an obstacle, the second is the number of capsules
    /// plus its index.
    pub pair: [u32; 2],
}

impl Clearance {
    /// Returns true if every pair is at least `distance_m` apart, m. False for NaN.
    pub fn is_at_least(&self, distance_m: f64) -> bool {
        self.distance_m >= distance_m
    }
}

/// A capsule in the base frame.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Axis {
    pub(crate) ends: [Vector3<f64>; 2],
    middle: Vector3<f64>,
    half_m: f64,
    pub(crate) radius_m: f64,
}

impl Axis {
    pub(crate) fn new(a: Vector3<f64>, b: Vector3<f64>, radius_m: f64) -> Self {
        Self { ends: [a, b], middle: (a + b) / 2.0, half_m: (b - a).norm() / 2.0, radius_m }
    }

    /// Distance between the balls around two capsules, m. It is never more than the distance of the capsules.
    pub(crate) fn bound_m(&self, other: &Self) -> f64 {
        (self.middle - other.middle).norm() - self.half_m - other.half_m - self.radius_m - other.radius_m
    }

    /// Longest path of an end since `before`, m. No other point of the axis moved farther.
    fn farthest_m(&self, before: &Self) -> f64 {
        let moved = [0, 1].map(|i| (self.ends[i] - before.ends[i]).norm_squared());
        moved[0].max(moved[1]).sqrt()
    }

    /// Distance between the ball around the capsule and a ball of `radius_m` about `center`, m.
    pub(crate) fn point_bound_m(&self, center: &Vector3<f64>, radius_m: f64) -> f64 {
        (self.middle - center).norm() - self.half_m - radius_m - self.radius_m
    }
}

/// Rounding of a distance and of the sums of paths, m. They begin again after [`MOVES_MAX`] postures.
const SPARE_M: f64 = 1e-6;
const MOVES_MAX: u32 = 1 << 16;

/// Distances of the last postures. A pair was D apart when it was measured. Since then no point of its two axes moved
/// farther than the ends' paths. While D less these paths is more than the least distance, it is not measured again.
#[derive(Clone, Debug)]
pub struct Distances {
    frames: Frames,
    axes: [Axis; CAPSULES_MAX],
    /// Path of each capsule so far, m.
    paths: [f64; CAPSULES_MAX],
    moves: u32,
    /// For each pair, its distance when it was measured plus the paths of both capsules then, m.
    bounds: Vec<f64>,
    nearest: usize,
}

impl Distances {
    /// Creates the memory for a robot of `model`. Nothing is known yet.
    pub fn new(model: &Model) -> Self {
        let (axes, paths) = ([Axis::default(); CAPSULES_MAX], [0.0; CAPSULES_MAX]);
        let bounds = vec![f64::NEG_INFINITY; model.pairs.len()];
        Self { frames: Frames::default(), axes, paths, moves: 0, bounds, nearest: 0 }
    }

    /// As [`clearance`]. Of pairs with exactly the same distance it may name another one. Never allocates.
    pub fn clearance(&mut self, model: &Model, q: &[f64; JOINTS_MAX]) -> Clearance {
        if q.iter().any(|q| !q.is_finite()) {
            return Clearance { distance_m: f64::NAN, pair: [0; 2] };
        }
        let Self { frames, axes, paths, bounds, nearest, .. } = self;
        model.forward(q, frames);
        for ((axis, path), capsule) in axes.iter_mut().zip(&mut *paths).zip(&model.capsules) {
            let before = std::mem::replace(axis, placed(frames, capsule));
            *path += axis.farthest_m(&before);
        }
        self.moves += 1;
        if self.moves > MOVES_MAX {
            (self.moves, *paths) = (0, [0.0; CAPSULES_MAX]);
            bounds.fill(f64::NEG_INFINITY);
        }
        let mut least = Clearance { distance_m: f64::INFINITY, pair: [0; 2] };
        // The pair that was nearest is measured first, so that most others are known to be farther apart.
        let first = *nearest;
        let order = model.pairs.iter().enumerate().skip(first).take(1).chain(model.pairs.iter().enumerate());
        for (index, pair) in order {
            let path = paths[pair.a] + paths[pair.b];
            if bounds[index] - path - SPARE_M > least.distance_m {
                continue;
            }
            let (a, b) = (&axes[pair.a], &axes[pair.b]);
            let distance_m = between_segments(&a.ends, &b.ends) - a.radius_m - b.radius_m;
            bounds[index] = distance_m + path;
            if distance_m < least.distance_m || distance_m.is_nan() {
                least = Clearance { distance_m, pair: [pair.a as u32, pair.b as u32] };
                *nearest = index;
            }
        }
        from_obstacles(model, axes, least)
    }
}

/// The axis of a capsule in the base frame.
fn placed(frames: &Frames, capsule: &Capsule) -> Axis {
    let pose = &frames.base_from_body[capsule.body];
    Axis::new(pose.r * capsule.a + pose.t, pose.r * capsule.b + pose.t, capsule.radius_m)
}

/// Least distance over the checked pairs of `model` and over its obstacles, at posture `q` (rad, m). `frames`
/// is working memory. Never allocates.
pub fn clearance(model: &Model, frames: &mut Frames, q: &[f64; JOINTS_MAX]) -> Clearance {
    if q.iter().any(|q| !q.is_finite()) {
        return Clearance { distance_m: f64::NAN, pair: [0; 2] };
    }
    model.forward(q, frames);
    let mut axes = [Axis::default(); CAPSULES_MAX];
    for (axis, capsule) in axes.iter_mut().zip(&model.capsules) {
        *axis = placed(frames, capsule);
    }
    let mut least = Clearance { distance_m: f64::INFINITY, pair: [0; 2] };
    for pair in &model.pairs {
        let (first, second) = (&axes[pair.a], &axes[pair.b]);
        if first.bound_m(second) >= least.distance_m {
            continue;
        }
        let distance_m = between_segments(&first.ends, &second.ends) - first.radius_m - second.radius_m;
        // NaN is taken and stays, because no distance is less than NaN.
        if distance_m < least.distance_m || distance_m.is_nan() {
            least = Clearance { distance_m, pair: [pair.a as u32, pair.b as u32] };
        }
    }
    from_obstacles(model, &axes, least)
}

/// The lesser of `least` and the least distance between a moving capsule and an obstacle.
fn from_obstacles(model: &Model, axes: &[Axis; CAPSULES_MAX], mut least: Clearance) -> Clearance {
    for (i, (axis, capsule)) in axes.iter().zip(&model.capsules).enumerate() {
        // Capsules of the base do not move, and neither do the obstacles.
        if capsule.body == 0 {
            continue;
        }
        for (k, obstacle) in model.obstacles.iter().enumerate() {
            let distance_m = match &obstacle.solid {
                Solid::HalfSpace { normal, offset_m } => above_plane(&axis.ends, normal, *offset_m),
                Solid::Box { center, r, half_m } => {
                    if axis.point_bound_m(center, half_m.norm()) >= least.distance_m {
                        continue;
                    }
                    from_box(&axis.ends.map(|end| r.tr_mul(&(end - center))), half_m)
                }
            } - axis.radius_m;
            if distance_m < least.distance_m || distance_m.is_nan() {
                least = Clearance { distance_m, pair: [i as u32, (model.capsules.len() + k) as u32] };
            }
        }
    }
    least
}

/// Height of a segment's lower end above the plane normal . x = offset, m.
pub(crate) fn above_plane(ends: &[Vector3<f64>; 2], normal: &Vector3<f64>, offset_m: f64) -> f64 {
    f64::min(normal.dot(&ends[0]), normal.dot(&ends[1])) - offset_m
}

/// Distance between a segment and the box |x_i| <= half_i, m. It is 0 if they meet.
///
/// Otherwise it is the least distance of an end from the box, or of the segment from one of the twelve edges.
/// Suppose that a point inside the segment is closest to a point inside a face. Then the segment is parallel
/// to that face. So one of its ends is as close, or the point where it passes above an edge.
pub(crate) fn from_box(ends: &[Vector3<f64>; 2], half: &Vector3<f64>) -> f64 {
    if meets_box(ends, half) {
        return 0.0;
    }
    let from_end = |p: &Vector3<f64>| (p - p.zip_map(half, |x, h| x.clamp(-h, h))).norm();
    let mut least = from_end(&ends[0]).min(from_end(&ends[1]));
    for axis in 0..3 {
        for corner in 0..4 {
            let mut from = *half;
            let (next, last) = ((axis + 1) % 3, (axis + 2) % 3);
            if corner & 1 != 0 {
                from[next] = -from[next];
            }
            if corner & 2 != 0 {
                from[last] = -from[last];
            }
            let mut to = from;
            to[axis] = -to[axis];
            least = least.min(between_segments(ends, &[from, to]));
        }
    }
    least
}

/// Returns true if a part of the segment lies between all three pairs of faces.
fn meets_box(ends: &[Vector3<f64>; 2], half: &Vector3<f64>) -> bool {
    let along = ends[1] - ends[0];
    let (mut enters, mut leaves) = (0.0_f64, 1.0_f64);
    for i in 0..3 {
        if along[i] == 0.0 {
            if ends[0][i].abs() > half[i] {
                return false;
            }
            continue;
        }
        let (s, t) = ((-half[i] - ends[0][i]) / along[i], (half[i] - ends[0][i]) / along[i]);
        enters = enters.max(s.min(t));
        leaves = leaves.min(s.max(t));
    }
    enters <= leaves
}

/// Distance between two segments, m.
///
/// If the infinite lines are closest at points inside both segments, it is the distance of these points.
/// Otherwise it is the least of the four distances from an end of one segment to the other segment. The
/// distance is convex in the two parameters. So its minimum over the square of parameters is inside or on an
/// edge, and an edge is an end against a segment.
pub(crate) fn between_segments(first: &[Vector3<f64>; 2], second: &[Vector3<f64>; 2]) -> f64 {
    let (u, w) = (first[1] - first[0], second[1] - second[0]);
    let mut squared = from_point(&first[0], second);
    for (point, segment) in [(&first[1], second), (&second[0], first), (&second[1], first)] {
        squared = squared.min(from_point(point, segment));
    }
    let normal = u.cross(&w);
    let area = normal.norm_squared();
    let r = second[0] - first[0];
    let s = r.cross(&w).dot(&normal) / area;
    let t = r.cross(&u).dot(&normal) / area;
    // For parallel lines s and t are NaN, infinite or arbitrary. Then an end is closest, and a pair of points
    // of the segments is never closer than the segments.
    if (0.0..=1.0).contains(&s) && (0.0..=1.0).contains(&t) {
        squared = squared.min((r + w * t - u * s).norm_squared());
    }
    squared.sqrt()
}

/// Squared distance from a point to a segment, m^2.
fn from_point(point: &Vector3<f64>, segment: &[Vector3<f64>; 2]) -> f64 {
    let along = segment[1] - segment[0];
    let length = along.norm_squared();
    let offset = point - segment[0];
    let s = if length > 0.0 { (offset.dot(&along) / length).clamp(0.0, 1.0) } else { 0.0 };
    (offset - along * s).norm_squared()
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};
    use robot::Pose;

    fn point(rng: &mut rand_pcg::Pcg64, size: f64) -> Vector3<f64> {
        Vector3::from_fn(|_, _| rng.random_range(-size..size))
    }

    #[test]
    fn segment_distances_match_robot_model() {
        let mut rng = rand_pcg::Pcg64::seed_from_u64(3);
        for n in 0..1_000_000 {
            let first = [point(&mut rng, 1.0), point(&mut rng, 1.0)];
            let start = point(&mut rng, 1.0);
            // Every third pair is almost parallel. Every seventh has a segment that is almost a point.
            let mut along =
                if n % 3 == 0 { (first[1] - first[0]) + point(&mut rng, 1e-7) } else { point(&mut rng, 1.0) };
            if n % 7 == 0 {
                along *= 1e-9;
            }
            let second = [start, start + along];
            let own = between_segments(&first, &second);
            let other = robot::segment_distance(&first[0], &first[1], &second[0], &second[1]).distance_m;
            assert!((own - other).abs() < 1e-9, "{n}: {own} {other} {first:?} {second:?}");
        }
    }

    #[test]
    fn distances_from_solids_match_robot_model() {
        let mut rng = rand_pcg::Pcg64::seed_from_u64(4);
        let mut meeting = 0;
        for n in 0..100_000 {
            let half = point(&mut rng, 0.5).abs() + Vector3::repeat(1e-3);
            let mut start = point(&mut rng, 1.0);
            // Every fifth segment begins in the plane of a face. Some are points, some are almost parallel to an edge.
            if n % 5 == 0 {
                start[n % 3] = half[n % 3];
            }
            let along = match n % 4 {
                0 => Vector3::x() * rng.random_range(-1.0..1.0) + point(&mut rng, 1e-9),
                1 => point(&mut rng, if n % 8 == 1 { 0.0 } else { 1e-10 } + 1e-300),
                _ => point(&mut rng, 1.0),
            };
            let ends = [start, start + along];
            let solid = Solid::Box { center: Vector3::zeros(), r: nalgebra::Matrix3::identity(), half_m: half };
            let (own, other) = (from_box(&ends, &half), solid.segment_distance(&ends[0], &ends[1]));
            assert!((own - other).abs() < 1e-9, "{n}: {own} {other} {ends:?} {half:?}");
            meeting += u32::from(own == 0.0);
            let normal = half.normalize();
            let solid = Solid::HalfSpace { normal, offset_m: 0.3 };
            let other = solid.segment_distance(&ends[0], &ends[1]);
            assert!((above_plane(&ends, &normal, 0.3) - other).abs() < 1e-12);
        }
        assert!(meeting > 1000, "{meeting}");
    }

    /// Boxes and a plane around the robot. Some are nearer to the robot than its own capsules are to each other.
    pub(crate) fn solids(rng: &mut rand_pcg::Pcg64) -> Vec<robot::Obstacle> {
        let floor = Solid::HalfSpace { normal: Vector3::z(), offset_m: rng.random_range(-0.3..0.3) };
        let turned = nalgebra::Rotation3::from_scaled_axis(point(rng, 2.0)).into_inner();
        let half_m = point(rng, 0.3).abs() + Vector3::repeat(0.01);
        let shelf = Solid::Box { center: point(rng, 1.0) + Vector3::z(), r: turned, half_m };
        let small = Solid::Box {
            center: point(rng, 0.8) + Vector3::z() * 0.5,
            r: nalgebra::Matrix3::identity(),
            half_m: Vector3::repeat(0.02),
        };
        let named = |solid| robot::Obstacle { name: "solid".into(), solid };
        [floor, shelf, small].into_iter().map(named).collect()
    }

    /// The two least distances over all pairs and obstacles, computed by the other implementation.
    pub(crate) fn all_distances(model: &Model, frames: &Frames) -> [(f64, [u32; 2]); 2] {
        let ends: Vec<_> = (model.capsules.iter())
            .map(|capsule| {
                let pose = &frames.base_from_body[capsule.body];
                (pose.transform_point(&capsule.a), pose.transform_point(&capsule.b))
            })
            .collect();
        let mut all = Vec::new();
        for pair in &model.pairs {
            let ((a0, a1), (b0, b1)) = (&ends[pair.a], &ends[pair.b]);
            let radii_m = model.capsules[pair.a].radius_m + model.capsules[pair.b].radius_m;
            let distance_m = robot::segment_distance(a0, a1, b0, b1).distance_m - radii_m;
            all.push((distance_m, [pair.a as u32, pair.b as u32]));
        }
        for (i, capsule) in model.capsules.iter().enumerate().filter(|(_, capsule)| capsule.body != 0) {
            for (k, obstacle) in model.obstacles.iter().enumerate() {
                let distance_m = obstacle.solid.segment_distance(&ends[i].0, &ends[i].1) - capsule.radius_m;
                all.push((distance_m, [i as u32, (model.capsules.len() + k) as u32]));
            }
        }
        all.sort_by(|a, b| a.0.total_cmp(&b.0));
        [all[0], all[1]]
    }

    pub(crate) fn shipped() -> Model {
        Model::from_text(
            "tiago_dual.toml",
            include_str!("../../../config/robots/tiago_dual.toml"),
            "tiago_dual.urdf",
            include_str!("../../../config/robots/tiago_dual.urdf"),
        )
        .expect("the robot of the repository loads")
    }

    #[test]
    fn clearance_is_least_distance_of_all_pairs() {
        let mut model = shipped();
        let mut rng = rand_pcg::Pcg64::seed_from_u64(5);
        let mut frames = Frames { base_from_body: [Pose::identity(); JOINTS_MAX + 1] };
        let (mut of_obstacles, mut overlapping) = (0, 0);
        for n in 0..4000 {
            if n % 20 == 0 {
                model.obstacles = if n % 40 == 0 { vec![] } else { solids(&mut rng) };
            }
            let q = model.limits.map(|limits| rng.random_range(limits.q_min..=limits.q_max));
            let own = clearance(&model, &mut frames, &q);
            let [least, next] = all_distances(&model, &frames);
            assert!((own.distance_m - least.0).abs() < 1e-9, "{n}: {own:?}, {least:?}");
            assert!(own.pair == least.1 || next.0 - least.0 < 1e-9, "{n}: {own:?}, {least:?}, {next:?}");
            of_obstacles += u32::from(own.pair[1] as usize >= model.capsules.len());
            overlapping += u32::from(own.distance_m < -0.01);
        }
        assert!(of_obstacles > 500 && overlapping > 500, "{of_obstacles}, {overlapping}");
        let mut nan = model.home;
        nan[3] = f64::NAN;
        assert!(clearance(&model, &mut frames, &nan).distance_m.is_nan());
    }

    /// A walk by steps of all sizes, with and without obstacles.
    #[test]
    fn known_distances_give_the_same_clearance() {
        let mut rng = rand_pcg::Pcg64::seed_from_u64(6);
        let mut frames = Frames { base_from_body: [Pose::identity(); JOINTS_MAX + 1] };
        for surrounded in [false, true] {
            let mut model = shipped();
            model.obstacles = if surrounded { solids(&mut rng) } else { vec![] };
            let mut distances = Distances::new(&model);
            let mut q = model.home;
            for n in 0..20_000 {
                let step = 10_f64.powf(rng.random_range(-6.0..-1.0));
                for (q, limits) in q.iter_mut().zip(&model.limits) {
                    *q = (*q + rng.random_range(-step..=step)).clamp(limits.q_min, limits.q_max);
                }
                let (own, all) = (distances.clearance(&model, &q), clearance(&model, &mut frames, &q));
                assert_eq!(own, all, "{n}");
            }
        }
    }

    #[test]
    fn segment_distances_match_known_geometry() {
        let segment = |a: [f64; 3], b: [f64; 3]| [Vector3::from(a), Vector3::from(b)];
        let x = segment([-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]);
        assert_eq!(between_segments(&x, &segment([0.0, -1.0, 0.5], [0.0, 1.0, 0.5])), 0.5, "crossing");
        assert_eq!(between_segments(&x, &segment([-3.0, 2.0, 0.0], [3.0, 2.0, 0.0])), 2.0, "parallel");
        assert_eq!(between_segments(&x, &segment([2.0, 0.0, 0.0], [4.0, 0.0, 0.0])), 1.0, "in line");
        assert_eq!(between_segments(&x, &segment([0.0, 0.0, 3.0], [0.0, 0.0, 3.0])), 3.0, "a point");
        let point = |p: [f64; 3]| segment(p, p);
        assert_eq!(between_segments(&point([0.0, 0.0, 3.0]), &point([0.0, 4.0, 0.0])), 5.0, "two points");
        assert_eq!(between_segments(&x, &segment([0.0, -1.0, 0.0], [0.0, 1.0, 0.0])), 0.0, "meeting");
    }
}
