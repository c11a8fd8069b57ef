//! The contents of a capsule, and their convex hull as proofs need it. They are made once, because fine meshes take long.

use crate::fragments::Fragments;
use crate::split::Matter;
use nalgebra::Vector3;
use robot::{Hull, Pose};
use std::collections::BTreeMap;
use std::fmt;
use std::sync::OnceLock;

/// Edges of the cubes in which one corner of a hull stands for all, from rough to fine, m (chosen).
const CUBES_M: [f64; 3] = [0.064, 0.016, 0.004];
/// Points of one ball, which are looked at together (chosen).
const BALL_POINTS: usize = 16;

pub struct Content {
    /// Surface and pieces in the frame of the capsule's link.
    pub matter: Matter,
    solid: OnceLock<Option<Solid>>,
    fragments: OnceLock<Option<Fragments>>,
}

impl Content {
    pub fn new(matter: Matter) -> Self {
        Self { matter, solid: OnceLock::new(), fragments: OnceLock::new() }
    }

    /// Returns the convex hull in the frame of the body, in which the link has this pose. A link stands still in its body.
    pub fn solid(&self, body_from_link: &Pose) -> Option<&Solid> {
        let place = |point: &Vector3<f64>| body_from_link.transform_point(point);
        let make = || Solid::new(&self.matter.points().iter().map(place).collect::<Vec<_>>());
        self.solid.get_or_init(make).as_ref()
    }

    /// Returns the surface as small hulls in the frame of the body.
    pub fn fragments(&self, body_from_link: &Pose) -> Option<&Fragments> {
        let make = || Fragments::new(&self.matter.map(|point| body_from_link.transform_point(point)));
        self.fragments.get_or_init(make).as_ref()
    }
}

impl fmt::Debug for Content {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.matter.fmt(f)
    }
}

/// A convex hull, with rough hulls inside it that are quicker to measure.
pub struct Solid {
    /// From rough to fine: a hull, and the largest distance of a corner of the whole hull from it, m. The last is the whole.
    hulls: Vec<(Hull, f64)>,
    pub cloud: Cloud,
    center: Vector3<f64>,
    radius_m: f64,
}

impl Solid {
    /// Creates the convex hull of points. `None` if they span no volume.
    fn new(points: &[Vector3<f64>]) -> Option<Self> {
        let whole = Hull::new(points)?;
        let corners = whole.corners();
        let center = corners.iter().sum::<Vector3<f64>>() / corners.len().max(1) as f64;
        let radius_m = corners.iter().map(|point| (point - center).norm()).fold(0.0, f64::max);
        let mut hulls: Vec<(Hull, f64)> = Vec::new();
        for cube_m in CUBES_M {
            let (few, off_m) = chosen(&corners, cube_m);
            let fewer_than_half = 2 * few.len() < corners.len();
            hulls.extend(fewer_than_half.then(|| Hull::new(&few)).flatten().map(|hull| (hull, off_m)));
        }
        hulls.push((whole, 0.0));
        Some(Self { hulls, cloud: Cloud::new(corners), center, radius_m })
    }

    /// Returns the distance of two hulls, m. The bounds are those of [`Distance`](crate::prove::Distance).
    ///
    /// A rough hull lies inside the whole one, and each point of the whole one at most `off` from it. So the distance of the
    /// whole ones is at most that of the rough ones, and less by both `off` at the most.
    pub fn distance_m(&self, pose: &Pose, other: &Self, other_pose: &Pose, [least_m, enough_m]: [f64; 2]) -> f64 {
        let centers = pose.transform_point(&self.center) - other_pose.transform_point(&other.center);
        let apart_m = centers.norm() - self.radius_m - other.radius_m;
        if apart_m > enough_m {
            return apart_m;
        }
        let mut distance_m = 0.0;
        for level in 0..self.hulls.len().max(other.hulls.len()) {
            let [(a, off_a), (b, off_b)] = [self, other].map(|solid| &solid.hulls[level.min(solid.hulls.len() - 1)]);
            distance_m = a.distance_m(pose, b, other_pose);
            let lowest_m = distance_m - off_a - off_b;
            if lowest_m > enough_m {
                return lowest_m;
            }
            let between = lowest_m > least_m && distance_m <= enough_m;
            if least_m.is_finite() && (distance_m <= least_m || between) {
                return distance_m;
            }
        }
        distance_m
    }
}

/// Returns fewer corners of a hull, one for each small cube, and the largest distance of a corner from the one that stands for
/// it, m.
fn chosen(corners: &[Vector3<f64>], cube_m: f64) -> (Vec<Vector3<f64>>, f64) {
    let mut chosen: BTreeMap<[i64; 3], Vector3<f64>> = BTreeMap::new();
    let mut off_m = 0.0_f64;
    for corner in corners {
        let cube = [0, 1, 2].map(|axis| (corner[axis] / cube_m).floor() as i64);
        off_m = off_m.max((*chosen.entry(cube).or_insert(*corner) - corner).norm());
    }
    (chosen.into_values().collect(), off_m)
}

/// Points in balls, to find quickly the one that is farthest from an axis.
pub struct Cloud(Vec<Ball>);

struct Ball {
    center: Vector3<f64>,
    radius_m: f64,
    points: Vec<Vector3<f64>>,
}

impl Cloud {
    pub fn new(points: Vec<Vector3<f64>>) -> Self {
        let mut balls = Vec::new();
        add(points, &mut balls);
        Self(balls)
    }

    /// Returns the largest distance of a point from the axis through `origin` along the unit vector `axis`, m.
    pub fn farthest_m(&self, axis: &Vector3<f64>, origin: &Vector3<f64>) -> f64 {
        let mut most_m = 0.0_f64;
        for Ball { center, radius_m, points } in &self.0 {
            // Its own rounding is far below this share.
            if (axis.cross(&(center - origin)).norm() + radius_m) * (1.0 + 1e-12) > most_m {
                let squared = points.iter().map(|point| axis.cross(&(point - origin)).norm_squared());
                most_m = most_m.max(squared.fold(0.0, f64::max).sqrt());
            }
        }
        most_m
    }
}

/// Halves points across their longest side until each part is small.
fn add(mut points: Vec<Vector3<f64>>, balls: &mut Vec<Ball>) {
    let Some(first) = points.first().copied() else { return };
    let low = points.iter().fold(first, |low, point| low.inf(point));
    let high = points.iter().fold(first, |high, point| high.sup(point));
    if points.len() > BALL_POINTS {
        let axis = (high - low).imax();
        points.sort_by(|a, b| a[axis].total_cmp(&b[axis]));
        let rest = points.split_off(points.len() / 2);
        add(points, balls);
        add(rest, balls);
        return;
    }
    let center = (low + high) * 0.5;
    let radius_m = points.iter().map(|point| (point - center).norm()).fold(0.0, f64::max);
    balls.push(Ball { center, radius_m, points });
}
