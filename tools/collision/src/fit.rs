//! The smallest capsule around a set of points.

use nalgebra::{SymmetricEigen, Vector3};
use robot::segment_distance;

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shape {
    /// One end of the axis, m.
    pub a: Vector3<f64>,
    /// The other end, m.
    pub b: Vector3<f64>,
    pub radius_m: f64,
}

impl Shape {
    /// Returns the volume, pi r^2 l + 4/3 pi r^3, m^3.
    pub fn volume_m3(&self) -> f64 {
        let r = self.radius_m;
        std::f64::consts::PI * r * r * ((self.b - self.a).norm() + 4.0 / 3.0 * r)
    }

    /// Returns the distance of two capsules, m. It is negative if they overlap.
    pub fn clearance_m(&self, other: &Self) -> f64 {
        segment_distance(&self.a, &self.b, &other.a, &other.b).distance_m - self.radius_m - other.radius_m
    }

    /// Returns how far a point lies outside, m. It is negative inside.
    pub fn outside_m(&self, point: &Vector3<f64>) -> f64 {
        let (along, from_point) = (self.b - self.a, self.a - point);
        let squared = |place: f64| (from_point + along * place).norm_squared();
        let length = along.norm_squared();
        let foot = if length > 0.0 { (-along.dot(&from_point) / length).clamp(0.0, 1.0) } else { 0.0 };
        squared(0.0).min(squared(1.0)).min(squared(foot)).sqrt() - self.radius_m
    }
}

/// Number of directions. The extreme points in these directions determine the capsule.
const DIRECTIONS: usize = 192;
/// The same for a rough volume.
const DIRECTIONS_ROUGH: usize = 64;
/// Iterations of one simplex search. It stalls well before.
const ITERATIONS: usize = 400;

/// Returns a capsule that contains all points, with locally smallest volume times radius^slimness. It is the
/// best of several starts. `None` without points. Slimness 0 gives the smallest volume. Slimness 2 gives a
/// longer capsule, for places where length does no harm.
pub fn smallest_capsule(points: &[Vector3<f64>], slimness: f64) -> Option<Shape> {
    if points.is_empty() {
        return None;
    }
    let extreme = extremes(points, DIRECTIONS);
    let (center, axes) = principal_axes(&extreme);
    let mut best: Option<(f64, [f64; 6])> = None;
    let coordinate = [Vector3::x(), Vector3::y(), Vector3::z()];
    for axis in axes.iter().chain(&coordinate) {
        let mut start = along(&extreme, &center, axis);
        // A simplex that collapsed too early recovers from a new one.
        for _ in 0..3 {
            start = simplex(&|x| cost(&extreme, x, slimness), start, 0.02).1;
        }
        let value = cost(&extreme, &start, slimness);
        if best.is_none_or(|(least, _)| value < least) {
            best = Some((value, start));
        }
    }
    best.map(|(_, x)| enclosing_capsule(points, &x))
}

/// Returns roughly the smallest capsule around points, much faster. It contains the extreme ones. `None` without points.
pub fn rough_capsule(points: &[Vector3<f64>]) -> Option<Shape> {
    if points.is_empty() {
        return None;
    }
    let extreme = extremes(points, DIRECTIONS_ROUGH);
    let (center, axes) = principal_axes(&extreme);
    let found = |axis| simplex(&|x| cost(&extreme, x, 0.0), along(&extreme, &center, axis), 0.02);
    let best = axes.iter().map(found).min_by(|a, b| a.0.total_cmp(&b.0));
    best.map(|(_, x)| enclosing_capsule(&extreme, &x))
}

/// Returns the capsule about the axis `x` = (a, b) that contains all points.
fn enclosing_capsule(points: &[Vector3<f64>], x: &[f64; 6]) -> Shape {
    let (a, b) = (Vector3::from_row_slice(&x[..3]), Vector3::from_row_slice(&x[3..]));
    let mut shape = Shape { a, b, radius_m: 0.0 };
    shape.radius_m = points.iter().map(|point| shape.outside_m(point)).fold(0.0, f64::max);
    shape
}

fn cost(points: &[Vector3<f64>], x: &[f64; 6], slimness: f64) -> f64 {
    let shape = enclosing_capsule(points, x);
    shape.volume_m3() * shape.radius_m.powf(slimness)
}

/// Points of one box, which are looked at together: neighbours in a file are neighbours in space (chosen).
const BOXED: usize = 64;

/// Returns the extreme points in evenly spread directions (a Fibonacci spiral).
fn extremes(points: &[Vector3<f64>], directions: usize) -> Vec<Vector3<f64>> {
    if points.len() <= directions {
        return points.to_vec();
    }
    let boxes: Vec<(Vector3<f64>, Vector3<f64>)> = points.chunks(BOXED).map(middle_and_half).collect();
    let golden = std::f64::consts::PI * (3.0 - 5.0_f64.sqrt());
    let mut chosen: Vec<usize> = (0..directions)
        .map(|i| {
            let z = 1.0 - (2.0 * i as f64 + 1.0) / directions as f64;
            let (sin, cos) = (golden * i as f64).sin_cos();
            let r = (1.0 - z * z).sqrt();
            extreme(points, &boxes, &Vector3::new(r * cos, r * sin, z))
        })
        .collect();
    chosen.sort_unstable();
    chosen.dedup();
    chosen.into_iter().map(|at| points[at]).collect()
}

/// Returns the index of the last point that is farthest in a direction. It leaves out boxes that end before.
fn extreme(points: &[Vector3<f64>], boxes: &[(Vector3<f64>, Vector3<f64>)], direction: &Vector3<f64>) -> usize {
    let (mut at, mut most) = (0, f64::NEG_INFINITY);
    for (index, (middle, half)) in boxes.iter().enumerate() {
        // The two small numbers are far more than rounding.
        if middle.dot(direction) + half.dot(&direction.abs()) * (1.0 + 1e-9) + 1e-12 < most {
            continue;
        }
        let first = index * BOXED;
        for (offset, point) in points[first..].iter().take(BOXED).enumerate() {
            let place = point.dot(direction);
            if place >= most {
                (at, most) = (first + offset, place);
            }
        }
    }
    at
}

fn middle_and_half(points: &[Vector3<f64>]) -> (Vector3<f64>, Vector3<f64>) {
    let low = points.iter().fold(points[0], |low, point| low.inf(point));
    let high = points.iter().fold(points[0], |high, point| high.sup(point));
    ((low + high) * 0.5, (high - low) * 0.5)
}

pub fn principal_axes(points: &[Vector3<f64>]) -> (Vector3<f64>, [Vector3<f64>; 3]) {
    let center = points.iter().sum::<Vector3<f64>>() / points.len() as f64;
    let spread = points.iter().map(|point| (point - center) * (point - center).transpose()).sum();
    let axes = SymmetricEigen::new(spread).eigenvectors;
    (center, [0, 1, 2].map(|i| axes.column(i).into_owned()))
}

/// Returns a first axis through the middle of the points along `axis`, shortened by their thickness.
fn along(points: &[Vector3<f64>], center: &Vector3<f64>, axis: &Vector3<f64>) -> [f64; 6] {
    let places = points.iter().map(|point| (point - center).dot(axis));
    let (low, high) = places.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), x| (l.min(x), h.max(x)));
    let thickness = points.iter().map(|point| (point - center).cross(axis).norm()).fold(0.0, f64::max);
    let half = (0.5 * (high - low) - 0.7 * thickness).max(0.01 * (high - low));
    let middle = center + axis * (0.5 * (low + high));
    let (a, b) = (middle - axis * half, middle + axis * half);
    [a.x, a.y, a.z, b.x, b.y, b.z]
}

/// Returns a minimum of `f` near `start` by the simplex method of Nelder and Mead (1965). The first simplex has
/// size `scale`.
fn simplex(f: &dyn Fn(&[f64; 6]) -> f64, start: [f64; 6], scale: f64) -> (f64, [f64; 6]) {
    let mut vertices: Vec<(f64, [f64; 6])> = (0..7)
        .map(|i| {
            let mut x = start;
            if i > 0 {
                x[i - 1] += scale;
            }
            (f(&x), x)
        })
        .collect();
    for _ in 0..ITERATIONS {
        vertices.sort_by(|a, b| a.0.total_cmp(&b.0));
        if vertices[6].0 - vertices[0].0 < 1e-12 * vertices[0].0 {
            break;
        }
        let centroid: [f64; 6] = std::array::from_fn(|k| vertices[..6].iter().map(|v| v.1[k]).sum::<f64>() / 6.0);
        let at = |step: f64| {
            let x = std::array::from_fn(|k| centroid[k] + step * (centroid[k] - vertices[6].1[k]));
            (f(&x), x)
        };
        let reflected = at(1.0);
        let next = if reflected.0 < vertices[0].0 {
            let expanded = at(2.0);
            if expanded.0 < reflected.0 { expanded } else { reflected }
        } else if reflected.0 < vertices[5].0 {
            reflected
        } else {
            at(if reflected.0 < vertices[6].0 { 0.5 } else { -0.5 })
        };
        if next.0 < vertices[6].0 {
            vertices[6] = next;
        } else {
            let best = vertices[0].1;
            for vertex in &mut vertices[1..] {
                vertex.1 = std::array::from_fn(|k| 0.5 * (vertex.1[k] + best[k]));
                vertex.0 = f(&vertex.1);
            }
        }
    }
    vertices.sort_by(|a, b| a.0.total_cmp(&b.0));
    vertices[0]
}
