//! Cuts a body's surface into cells, each with its own capsule.

use crate::fit::{Shape, principal_axes, smallest_capsule};
use crate::mesh::Points;
use crate::plan::Cut;
use nalgebra::Vector3;

/// Contents of capsules: surface that may be cut, and pieces that may not.
#[derive(Clone, Debug, Default)]
pub struct Matter {
    /// Flat convex polygons.
    pub surface: Vec<Points>,
    /// Convex pieces. Each lies in one capsule as a whole.
    pub pieces: Vec<Points>,
}

impl Matter {
    /// Returns the same matter at another place.
    pub fn map(&self, place: impl Fn(&Vector3<f64>) -> Vector3<f64>) -> Self {
        let map = |sets: &[Points]| sets.iter().map(|points| points.iter().map(&place).collect()).collect();
        Self { surface: map(&self.surface), pieces: map(&self.pieces) }
    }

    /// Returns all points.
    pub fn points(&self) -> Points {
        self.surface.iter().chain(&self.pieces).flatten().copied().collect()
    }

    /// Returns the parts below and above the plane {x : normal . x = offset}. Polygons are cut, and pieces go
    /// to the side of their middle.
    fn cut(&self, normal: &Vector3<f64>, offset: f64) -> [Self; 2] {
        let mut halves = [Self::default(), Self::default()];
        for polygon in &self.surface {
            for (half, sign) in halves.iter_mut().zip([-1.0, 1.0]) {
                let kept = clip(polygon, &(normal * sign), offset * sign);
                if !kept.is_empty() {
                    half.surface.push(kept);
                }
            }
        }
        for piece in &self.pieces {
            let middle = piece.iter().sum::<Vector3<f64>>() / piece.len() as f64;
            halves[usize::from(normal.dot(&middle) > offset)].pieces.push(piece.clone());
        }
        halves
    }
}

/// Returns the rest of a convex polygon where normal . x >= offset (Sutherland and Hodgman, 1974).
fn clip(polygon: &Points, normal: &Vector3<f64>, offset: f64) -> Points {
    let mut kept = Points::with_capacity(polygon.len() + 1);
    for (i, here) in polygon.iter().enumerate() {
        let next = &polygon[(i + 1) % polygon.len()];
        let (at, to) = (normal.dot(here) - offset, normal.dot(next) - offset);
        if at >= 0.0 {
            kept.push(*here);
        }
        if (at < 0.0) != (to < 0.0) {
            kept.push(here + (next - here) * (at / (at - to)));
        }
    }
    kept
}

/// A cell and its capsule.
#[derive(Clone, Debug)]
pub struct Cell {
    /// Contents of the capsule.
    pub matter: Matter,
    /// The capsule, without margin.
    pub shape: Shape,
}

fn slim_cell(matter: Matter, slimness: f64) -> Option<Cell> {
    smallest_capsule(&matter.points(), slimness).map(|shape| Cell { matter, shape })
}

/// Positions of the cuts that are tried, as a share of a cell's extent.
const CUTS: [f64; 5] = [0.3, 0.4, 0.5, 0.6, 0.7];

/// Returns at most `count` cells of small volume. First come the given cuts, then always the cut that saves the
/// most.
pub fn split(matter: Matter, count: usize, cuts: &[Cut], slimness: f64) -> Vec<Cell> {
    let mut parts = vec![matter];
    for cut in cuts {
        let [below, above] = parts[cut.part].cut(&Vector3::from(cut.normal), cut.offset_m);
        parts[cut.part] = below;
        parts.push(above);
    }
    let mut cells: Vec<Cell> = parts.into_iter().filter_map(|part| slim_cell(part, slimness)).collect();
    if cells.len() >= count {
        return cells;
    }
    let mut cuts: Vec<Option<(f64, [Cell; 2])>> = cells.iter().map(best_cut).collect();
    while cells.len() < count {
        let saved = |at: &usize| cuts[*at].as_ref().map_or(f64::NEG_INFINITY, |cut| cut.0);
        let Some(at) = (0..cells.len()).max_by(|a, b| saved(a).total_cmp(&saved(b))) else {
            break;
        };
        let Some((_, [low, high])) = cuts[at].take() else { break };
        (cuts[at], cells[at]) = (best_cut(&low), low);
        cuts.push(best_cut(&high));
        cells.push(high);
    }
    cells
}

/// Returns the cut of a cell in two that saves the most volume, m^3.
fn best_cut(whole: &Cell) -> Option<(f64, [Cell; 2])> {
    let points = whole.matter.points();
    let (_, axes) = principal_axes(&points);
    let mut best: Option<(f64, [Cell; 2])> = None;
    for axis in axes.iter().chain(&[Vector3::x(), Vector3::y(), Vector3::z()]) {
        let places = points.iter().map(|point| point.dot(axis));
        let (low, high) = places.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), x| (l.min(x), h.max(x)));
        for share in CUTS {
            let [below, above] = whole.matter.cut(axis, low + share * (high - low));
            let (Some(below), Some(above)) = (slim_cell(below, 0.0), slim_cell(above, 0.0)) else {
                continue;
            };
            let saved = whole.shape.volume_m3() - below.shape.volume_m3() - above.shape.volume_m3();
            if best.as_ref().is_none_or(|(most, _)| saved > *most) {
                best = Some((saved, [below, above]));
            }
        }
    }
    best
}
