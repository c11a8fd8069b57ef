//! Cuts a body's surface into cells, each with its own capsule.

use crate::fit::{Shape, principal_axes, rough_capsule, smallest_capsule};
use crate::mesh::Points;
use crate::plan::Cut;
use nalgebra::Vector3;
use rayon::prelude::*;
use std::sync::OnceLock;

/// Contents of capsules: surface that may be cut, and pieces that may not.
#[derive(Clone, Debug, Default)]
pub struct Matter {
    pub surface: Vec<Points>,
    pub pieces: Vec<Points>,
}

impl Matter {
    pub fn map(&self, place: impl Fn(&Vector3<f64>) -> Vector3<f64>) -> Self {
        let map = |sets: &[Points]| sets.iter().map(|points| points.iter().map(&place).collect()).collect();
        Self { surface: map(&self.surface), pieces: map(&self.pieces) }
    }

    pub fn points(&self) -> Points {
        self.surface.iter().chain(&self.pieces).flatten().copied().collect()
    }

    /// Returns the parts below and above the plane {x : normal . x = offset}. Polygons are cut, and pieces go
    /// to the side of their middle.
    pub fn cut(&self, normal: &Vector3<f64>, offset: f64) -> [Self; 2] {
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

    /// Returns the points of both parts that [`Matter::cut`] gives.
    fn cut_points(&self, normal: &Vector3<f64>, offset: f64) -> [Points; 2] {
        let mut halves = [Points::new(), Points::new()];
        for polygon in &self.surface {
            let Some(mut here) = polygon.last() else { continue };
            let mut at = normal.dot(here) - offset;
            for next in polygon {
                let to = normal.dot(next) - offset;
                if (at < 0.0) != (to < 0.0) {
                    let crossing = here + (next - here) * (at / (at - to));
                    halves.iter_mut().for_each(|half| half.push(crossing));
                }
                halves[usize::from(to >= 0.0)].push(*next);
                (here, at) = (next, to);
            }
        }
        for piece in &self.pieces {
            let middle = piece.iter().sum::<Vector3<f64>>() / piece.len() as f64;
            halves[usize::from(normal.dot(&middle) > offset)].extend(piece);
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

#[derive(Clone, Debug)]
pub struct Cell {
    pub matter: Matter,
    /// The capsule, without margin.
    pub shape: Shape,
    volume_ratio: OnceLock<f64>,
}

impl Cell {
    /// Returns the ratio of the volumes of the capsule and of the convex hull inside. NaN if the hull has none.
    pub fn volume_ratio(&self) -> f64 {
        let hull_m3 = || robot::hull_volume_oracle(&self.matter.points());
        *self.volume_ratio.get_or_init(|| hull_m3().map_or(f64::NAN, |volume| self.shape.volume_m3() / volume))
    }
}

fn slim_cell(matter: Matter, slimness: f64) -> Option<Cell> {
    smallest_capsule(&matter.points(), slimness).map(|shape| Cell { matter, shape, volume_ratio: OnceLock::new() })
}

/// Positions of the cuts that are tried, as a share of a cell's extent.
const CUTS: [f64; 5] = [0.3, 0.4, 0.5, 0.6, 0.7];
/// A cut away from another capsule must gain at least this distance, m (chosen).
const GAINED_M: f64 = 0.01;
/// Number of the best first cuts for which a second one is tried (chosen).
const AHEAD: usize = 6;

/// Normal and offset of a plane, m.
type Plane = (Vector3<f64>, f64);

#[derive(Clone, Debug)]
struct Halves {
    saved_m3: f64,
    plane: Plane,
    cells: [Cell; 2],
}

/// Cuts contents into more and more cells.
#[derive(Clone)]
pub struct Splitter {
    cells: Vec<Cell>,
    /// The best cut of each cell, where it is known. The inner one is absent if the cell cannot be cut.
    halves: Vec<Option<Option<Halves>>>,
    cuts: Vec<Cut>,
}

impl Splitter {
    pub fn new(matter: Matter, cuts: &[Cut], slimness: f64) -> Self {
        let mut parts = vec![matter];
        for cut in cuts {
            let [below, above] = parts[cut.part].cut(&Vector3::from(cut.normal), cut.offset_m);
            parts[cut.part] = below;
            parts.push(above);
        }
        let cells: Vec<Cell> = parts.into_par_iter().filter_map(|part| slim_cell(part, slimness)).collect();
        Self { halves: vec![None; cells.len()], cells, cuts: cuts.to_vec() }
    }

    pub fn cells(&self) -> &[Cell] {
        &self.cells
    }

    pub fn cuts(&self) -> &[Cut] {
        &self.cuts
    }

    /// Returns the volume that the best cut of a cell saves, m^3. `None` if it cannot be cut.
    pub fn saving_m3(&mut self, at: usize) -> Option<f64> {
        let halves = self.halves[at].get_or_insert_with(|| best_cut(&self.cells[at]));
        halves.as_ref().map(|halves| halves.saved_m3)
    }

    /// Cuts a cell in two. Returns false if it cannot be cut.
    pub fn cut(&mut self, at: usize) -> bool {
        if self.saving_m3(at).is_none() {
            return false;
        }
        let Some(Halves { plane, cells, .. }) = self.halves[at].take().flatten() else {
            return false;
        };
        self.replace(at, &plane, cells);
        true
    }

    fn replace(&mut self, at: usize, (normal, offset_m): &Plane, [low, high]: [Cell; 2]) {
        self.cuts.push(Cut { part: at, normal: (*normal).into(), offset_m: *offset_m });
        self.cells[at] = low;
        self.cells.push(high);
        self.halves[at] = None;
        self.halves.push(None);
    }

    /// Cuts a cell so that its capsules stay farther from another one, given in the same frame. If one cut gains too
    /// little, it looks for the two that gain most: the second one halves the nearer half. Returns false if that gains
    /// too little, or needs more cells than there may be.
    pub fn cut_away(&mut self, at: usize, other: &Shape, cells_max: usize) -> bool {
        if self.cells.len() >= cells_max {
            return false;
        }
        let enough_m = self.cells[at].shape.clearance_m(other) + GAINED_M;
        let mut first = cuts_away(&self.cells[at].matter, other);
        first.truncate(AHEAD);
        if let Some(Away { plane, .. }) = first.first().filter(|away| away.least_m() >= enough_m) {
            return self.cut_at(at, plane);
        }
        let second = |away: &Away| {
            let nearer = usize::from(away.apart_m[1] < away.apart_m[0]);
            let half = &self.cells[at].matter.cut(&away.plane.0, away.plane.1)[nearer];
            let next = cuts_away(half, other).into_iter().next()?;
            Some((next.least_m().min(away.apart_m[1 - nearer]), nearer, next.plane))
        };
        let both = first.iter().filter_map(|away| Some((away.plane, second(away)?)));
        let best = both.max_by(|a, b| a.1.0.total_cmp(&b.1.0));
        let enough = |found: &(Plane, (f64, usize, Plane))| found.1.0 >= enough_m && self.cells.len() + 2 <= cells_max;
        let Some((plane, (_, nearer, next))) = best.filter(enough) else { return false };
        let (low, high) = (at, self.cells.len());
        self.cut_at(at, &plane) && self.cut_at([low, high][nearer], &next)
    }

    fn cut_at(&mut self, at: usize, plane: &Plane) -> bool {
        let [low, high] = self.cells[at].matter.cut(&plane.0, plane.1).map(|half| slim_cell(half, 0.0));
        let (Some(low), Some(high)) = (low, high) else { return false };
        self.replace(at, plane, [low, high]);
        true
    }
}

/// A cut, and how far the rough capsules of both halves then stay from another capsule, m.
struct Away {
    plane: Plane,
    apart_m: [f64; 2],
}

impl Away {
    fn least_m(&self) -> f64 {
        self.apart_m[0].min(self.apart_m[1])
    }
}

/// Returns the cuts of contents, the one first whose capsules stay farthest from another one.
fn cuts_away(matter: &Matter, other: &Shape) -> Vec<Away> {
    let away = |plane: &Plane| {
        let [low, high] = matter.cut_points(&plane.0, plane.1).map(|half| rough_capsule(&half));
        Some(Away { plane: *plane, apart_m: [low?.clearance_m(other), high?.clearance_m(other)] })
    };
    let mut cuts: Vec<Away> = planes(&matter.points()).par_iter().filter_map(away).collect();
    cuts.sort_by(|a, b| b.least_m().total_cmp(&a.least_m()));
    cuts
}

/// Returns at most `count` cells of small volume. First come the given cuts, then always the cut that saves the
/// most.
pub fn split(matter: Matter, count: usize, cuts: &[Cut], slimness: f64) -> Vec<Cell> {
    let mut splitter = Splitter::new(matter, cuts, slimness);
    while splitter.cells.len() < count {
        let savings = (0..splitter.cells.len()).filter_map(|at| Some((at, splitter.saving_m3(at)?)));
        let most = savings.max_by(|a, b| a.1.total_cmp(&b.1));
        if !most.is_some_and(|(at, _)| splitter.cut(at)) {
            break;
        }
    }
    splitter.cells
}

/// Returns the planes that are tried.
fn planes(points: &[Vector3<f64>]) -> Vec<Plane> {
    if points.is_empty() {
        return Vec::new();
    }
    let (_, axes) = principal_axes(points);
    let coordinate = [Vector3::x(), Vector3::y(), Vector3::z()];
    let planes = axes.iter().chain(&coordinate).flat_map(|axis| {
        let places = points.iter().map(|point| point.dot(axis));
        let (low, high) = places.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), x| (l.min(x), h.max(x)));
        CUTS.map(|share| (*axis, low + share * (high - low)))
    });
    planes.collect()
}

/// Returns the cut of a cell in two that saves the most volume.
fn best_cut(whole: &Cell) -> Option<Halves> {
    let planes = planes(&whole.matter.points());
    let volume_m3 = |(normal, offset_m): &Plane| {
        let [below, above] = whole.matter.cut_points(normal, *offset_m);
        Some(rough_capsule(&below)?.volume_m3() + rough_capsule(&above)?.volume_m3())
    };
    let volumes: Vec<Option<f64>> = planes.par_iter().map(volume_m3).collect();
    let known = planes.iter().zip(volumes).filter_map(|(plane, volume)| Some((plane, volume?)));
    let (&plane, _) = known.min_by(|a, b| a.1.total_cmp(&b.1))?;
    let [below, above] = whole.matter.cut(&plane.0, plane.1);
    let cells = [slim_cell(below, 0.0)?, slim_cell(above, 0.0)?];
    let saved_m3 = whole.shape.volume_m3() - cells.iter().map(|cell| cell.shape.volume_m3()).sum::<f64>();
    Some(Halves { saved_m3, plane, cells })
}
