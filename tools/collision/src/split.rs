//! Cuts a body's surface into cells, each with its own capsule.

use crate::fit::{Shape, principal_axes, rough_volume_m3, smallest_capsule};
use crate::mesh::Points;
use crate::plan::Cut;
use nalgebra::Vector3;
use rayon::prelude::*;

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
}

impl Cell {
    /// Returns the ratio of the volumes of the capsule and of the convex hull inside. NaN if the hull has none.
    pub fn volume_ratio(&self) -> f64 {
        robot::hull_volume_oracle(&self.matter.points()).map_or(f64::NAN, |volume| self.shape.volume_m3() / volume)
    }
}

fn slim_cell(matter: Matter, slimness: f64) -> Option<Cell> {
    smallest_capsule(&matter.points(), slimness).map(|shape| Cell { matter, shape })
}

/// Positions of the cuts that are tried, as a share of a cell's extent.
const CUTS: [f64; 5] = [0.3, 0.4, 0.5, 0.6, 0.7];

#[derive(Clone, Debug)]
struct Halves {
    saved_m3: f64,
    normal: Vector3<f64>,
    offset_m: f64,
    cells: [Cell; 2],
}

/// Cuts contents into more and more cells.
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
        let Some(Halves { normal, offset_m, cells: [low, high], .. }) = self.halves[at].take().flatten() else {
            return false;
        };
        self.cuts.push(Cut { part: at, normal: normal.into(), offset_m });
        self.cells[at] = low;
        self.cells.push(high);
        self.halves.push(None);
        true
    }
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

/// Returns the cut of a cell in two that saves the most volume.
fn best_cut(whole: &Cell) -> Option<Halves> {
    let points = whole.matter.points();
    let (_, axes) = principal_axes(&points);
    let coordinate = [Vector3::x(), Vector3::y(), Vector3::z()];
    let planes = axes.iter().chain(&coordinate).flat_map(|axis| {
        let places = points.iter().map(|point| point.dot(axis));
        let (low, high) = places.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), x| (l.min(x), h.max(x)));
        CUTS.map(|share| (*axis, low + share * (high - low)))
    });
    let planes: Vec<(Vector3<f64>, f64)> = planes.collect();
    let volume_m3 = |(normal, offset_m): &(Vector3<f64>, f64)| {
        let [below, above] = whole.matter.cut(normal, *offset_m);
        Some(rough_volume_m3(&below.points())? + rough_volume_m3(&above.points())?)
    };
    let volumes: Vec<Option<f64>> = planes.par_iter().map(volume_m3).collect();
    let known = planes.iter().zip(volumes).filter_map(|(plane, volume)| Some((plane, volume?)));
    let (&(normal, offset_m), _) = known.min_by(|a, b| a.1.total_cmp(&b.1))?;
    let [below, above] = whole.matter.cut(&normal, offset_m);
    let cells = [slim_cell(below, 0.0)?, slim_cell(above, 0.0)?];
    let saved_m3 = whole.shape.volume_m3() - cells.iter().map(|cell| cell.shape.volume_m3()).sum::<f64>();
    Some(Halves { saved_m3, normal, offset_m, cells })
}
