//! Draws front and side view of a robot: capsules over the corners of their contents. Draws several robots in a row.

use crate::error::CollisionError;
use crate::fit::Shape;
use crate::mesh::Points;
use canvas::{Area, Drawn};
use messages::JOINTS_MAX;
use nalgebra::Vector3;
use plotters::prelude::*;
use robot::{Frames, Model, Pose};
use std::path::Path;

/// Size of the picture, pixels.
const SIZE: (u32, u32) = (1_600, 900);
const ROW_SIZE: (u32, u32) = (1_400, 420);
/// Free margin around the robot, m.
const FREE_M: f64 = 0.1;
/// Number of corners of a half circle.
const CORNERS: usize = 16;
/// Largest number of points. More points are thinned out.
const POINTS_MAX: usize = 40_000;

pub struct Cloud {
    pub link: String,
    pub points: Points,
}

/// Returns the outline of a capsule, seen along an axis: a stadium, or a circle if it is seen from its end.
fn outline(ends: [(f64, f64); 2], radius: f64) -> Vec<(f64, f64)> {
    let [(ax, ay), (bx, by)] = ends;
    let heading = if ax == bx && ay == by { 0.0 } else { (by - ay).atan2(bx - ax) };
    let half = |(x, y): (f64, f64), from: f64| {
        (0..=CORNERS).map(move |i| {
            let (sin, cos) = (from + std::f64::consts::PI * i as f64 / CORNERS as f64).sin_cos();
            (x + radius * cos, y + radius * sin)
        })
    };
    let quarter = std::f64::consts::FRAC_PI_2;
    half((bx, by), heading - quarter).chain(half((ax, ay), heading + quarter)).collect()
}

/// The two views: from the front (y and z, with the robot's left on the viewer's right), and from its right
/// side (x and z).
type View = fn(&Vector3<f64>) -> (f64, f64);

const VIEWS: [View; 2] = [|p| (p.y, p.z), |p| (p.x, p.z)];

/// Draws the robot in the posture `q` into a PNG.
pub fn draw(model: &Model, q: &[f64; JOINTS_MAX], clouds: &[Cloud], out: &Path) -> Result<(), CollisionError> {
    let mut frames = Frames::default();
    model.forward(q, &mut frames);
    let capsules: Vec<Shape> = placed(model, &frames).into_iter().map(|(shape, _)| shape).collect();
    let mut points = Points::new();
    for cloud in clouds {
        let pose: Option<Pose> = model.link_pose(&frames, &cloud.link);
        points.extend(pose.iter().flat_map(|pose| cloud.points.iter().map(|point| pose.transform_point(point))));
    }
    let points: Points = points.iter().step_by(points.len() / POINTS_MAX + 1).copied().collect();
    save(out, SIZE, |area| views(area, &capsules, &points))
}

/// Draws the capsules of several robots from the front, side by side on one floor and in one scale. Arms have their own
/// colour.
pub fn draw_row(robots: &[(&Model, [f64; JOINTS_MAX])], out: &Path) -> Result<(), CollisionError> {
    let mut row: Vec<(Shape, bool)> = Vec::new();
    let mut right = 0.0;
    for (model, q) in robots {
        let mut frames = Frames::default();
        model.forward(q, &mut frames);
        let shapes = placed(model, &frames);
        let lowest = |of: fn(&Vector3<f64>) -> f64| {
            shapes.iter().map(|(s, _)| of(&s.a).min(of(&s.b)) - s.radius_m).fold(f64::INFINITY, f64::min)
        };
        let (left, floor, width) = (lowest(|p| p.y), lowest(|p| p.z), -lowest(|p| -p.y) - lowest(|p| p.y));
        let shift = Vector3::new(0.0, right - left, -floor);
        row.extend(shapes.iter().map(|(s, arm)| (Shape { a: s.a + shift, b: s.b + shift, ..*s }, *arm)));
        right += width + FREE_M;
    }
    // The viewer stands in front. What is nearer covers what is behind.
    row.sort_by(|(s, _), (t, _)| (s.a.x + s.b.x).total_cmp(&(t.a.x + t.b.x)));
    save(out, ROW_SIZE, |area| front(area, &row))
}

fn placed(model: &Model, frames: &Frames) -> Vec<(Shape, bool)> {
    let shape = |c: &robot::Capsule| {
        let place = |point| frames.base_from_body[c.body].transform_point(point);
        let arm = model.arms.iter().any(|arm| arm.joints.iter().any(|j| c.body == j + 1));
        (Shape { a: place(&c.a), b: place(&c.b), radius_m: c.radius_m }, arm)
    };
    model.capsules.iter().map(shape).collect()
}

fn save(out: &Path, size: (u32, u32), draw: impl FnOnce(&Area<'_>) -> Drawn) -> Result<(), CollisionError> {
    let failed = |cause: String| CollisionError::content(out.display().to_string(), cause);
    if out.extension().is_none_or(|extension| extension != "png") {
        return Err(failed("must end in .png".into()));
    }
    std::fs::OpenOptions::new()
        .create(true)
        .append(true)
        .open(out)
        .map_err(|cause| CollisionError::Write { path: out.to_path_buf(), cause })?;
    // The canvas has two points for each pixel.
    canvas::save(out, (2 * size.0, 2 * size.1), draw).map_err(failed)
}

fn front(area: &Area<'_>, row: &[(Shape, bool)]) -> Drawn {
    let (w, h) = area.dim_in_pixel();
    let line = w / ROW_SIZE.0;
    let most = |of: fn(&Vector3<f64>) -> f64| {
        row.iter().map(|(s, _)| of(&s.a).max(of(&s.b)) + s.radius_m).fold(f64::NEG_INFINITY, f64::max)
    };
    let (wide, high) = (most(|p| p.y), most(|p| p.z));
    let scale = ((wide + 2.0 * FREE_M) / f64::from(w)).max((high + 2.0 * FREE_M) / f64::from(h));
    let left = 0.5 * (f64::from(w) - wide / scale);
    for (shape, arm) in row {
        let ends = [&shape.a, &shape.b].map(|p| (p.y, p.z));
        let pixel = |(y, z): &(f64, f64)| {
            ((left + y / scale).round() as i32, (f64::from(h) - (z + FREE_M) / scale).round() as i32)
        };
        let corners: Vec<(i32, i32)> = outline(ends, shape.radius_m).iter().map(pixel).collect();
        let colour = if *arm { RGBColor(90, 140, 230) } else { RGBColor(205, 210, 218) };
        area.draw(&Polygon::new(corners.clone(), colour.filled()))?;
        let closed: Vec<(i32, i32)> = corners.iter().chain(corners.first()).copied().collect();
        area.draw(&PathElement::new(closed, RGBColor(60, 70, 90).stroke_width(line)))?;
    }
    Ok(())
}

fn views(area: &Area<'_>, capsules: &[Shape], points: &[Vector3<f64>]) -> Drawn {
    let line = area.dim_in_pixel().0 / SIZE.0;
    for (panel, view) in area.split_evenly((1, 2)).iter().zip(VIEWS) {
        let outlines: Vec<Vec<(f64, f64)>> =
            capsules.iter().map(|c| outline([view(&c.a), view(&c.b)], c.radius_m)).collect();
        let all = outlines.iter().flatten();
        let (mut low, mut high) = ((f64::INFINITY, f64::INFINITY), (f64::NEG_INFINITY, f64::NEG_INFINITY));
        for (x, y) in all {
            (low, high) = ((low.0.min(*x), low.1.min(*y)), (high.0.max(*x), high.1.max(*y)));
        }
        // Both directions have the same scale, and the robot is in the middle.
        let (w, h) = panel.dim_in_pixel();
        let scale =
            ((high.0 - low.0 + 2.0 * FREE_M) / f64::from(w)).max((high.1 - low.1 + 2.0 * FREE_M) / f64::from(h));
        let middle = (0.5 * (low.0 + high.0), 0.5 * (low.1 + high.1));
        let pixel = |(x, y): (f64, f64)| {
            let across = (x - middle.0) / scale + 0.5 * f64::from(w);
            let down = 0.5 * f64::from(h) - (y - middle.1) / scale;
            (across.round() as i32, down.round() as i32)
        };
        for point in points {
            panel.draw(&Circle::new(pixel(view(point)), line, BLACK.mix(0.35).filled()))?;
        }
        for outline in &outlines {
            let corners: Vec<(i32, i32)> = outline.iter().map(|corner| pixel(*corner)).collect();
            panel.draw(&Polygon::new(corners.clone(), BLUE.mix(0.08)))?;
            let closed: Vec<(i32, i32)> = corners.iter().chain(corners.first()).copied().collect();
            panel.draw(&PathElement::new(closed, BLUE.mix(0.6).stroke_width(line)))?;
        }
    }
    Ok(())
}
