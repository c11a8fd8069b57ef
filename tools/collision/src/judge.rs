//! Decides which pairs need no check, by proof.

use crate::fit::Shape;
use crate::fragments::Fragments;
use crate::plan::Plan;
use crate::prove::{CELLS_MAX, Distance, Part, Verdict, deciding_joints, prove, prove_overlap, prove_parts};
use crate::write::Named;
use nalgebra::Vector3;
use robot::{AllowedReason, Capsule, Frames, Hull, Model};
use std::collections::BTreeMap;
use std::fmt;
use std::sync::OnceLock;

/// Decides about pairs, and caches convex hulls and fragments.
pub struct Judge<'a> {
    model: &'a Model,
    plan: &'a Plan,
    capsules: &'a [Named],
    hulls: Vec<OnceLock<Option<Hull>>>,
    fragments: Vec<OnceLock<Option<Fragments>>>,
}

/// Largest number of deciding joints for which a proof by hulls is tried: parts of one shoulder or wrist, or a
/// neck.
const HULL_JOINTS_MAX: usize = 3;
/// Largest number of cells that a proof by fragments may visit. Their distances are slow.
const FRAGMENT_CELLS_MAX: usize = 20_000;

/// Edge of the cubes in which one corner of a hull stands for all, m (chosen).
const CUBE_M: f64 = 0.004;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum By {
    Capsules,
    Hulls,
    Fragments,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Proof {
    /// They stay at least this far apart, m.
    pub at_least_m: f64,
    pub by: By,
}

impl fmt::Display for Proof {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let what = match self.by {
            By::Capsules => "capsules",
            By::Hulls => "convex hulls",
            By::Fragments => "surfaces",
        };
        write!(f, "at least {:.1} mm ({what})", self.at_least_m * 1e3)
    }
}

impl<'a> Judge<'a> {
    pub fn new(model: &'a Model, plan: &'a Plan, capsules: &'a [Named]) -> Self {
        let hulls = capsules.iter().map(|_| OnceLock::new()).collect();
        Self { model, plan, capsules, hulls, fragments: capsules.iter().map(|_| OnceLock::new()).collect() }
    }

    pub fn model(&self) -> &'a Model {
        self.model
    }

    fn on_body(&self, index: usize, shape: &Shape) -> Option<Capsule> {
        let named = &self.capsules[index];
        let (body, pose) = self.model.link_body(&named.link)?;
        let (a, b) = (pose.transform_point(&shape.a), pose.transform_point(&shape.b));
        Some(Capsule { name: named.name.clone(), body, a, b, radius_m: shape.radius_m })
    }

    fn body(&self, index: usize) -> Option<usize> {
        self.model.link_body(&self.capsules[index].link).map(|(body, _)| body)
    }

    fn hull(&self, index: usize) -> Option<&Hull> {
        let make = || {
            let named = &self.capsules[index];
            let (_, pose) = self.model.link_body(&named.link)?;
            let points: Vec<_> = named.matter.points().iter().map(|point| pose.transform_point(point)).collect();
            Hull::new(&points)
        };
        self.hulls[index].get_or_init(make).as_ref()
    }

    fn fragments(&self, index: usize) -> Option<&Fragments> {
        let make = || {
            let named = &self.capsules[index];
            let (_, pose) = self.model.link_body(&named.link)?;
            Fragments::new(&named.matter.map(|point| pose.transform_point(point)))
        };
        self.fragments[index].get_or_init(make).as_ref()
    }

    /// Returns the distance of two capsules' contents, by fragments, m. If it is above `enough_m`, the result is a lower
    /// bound above that.
    pub fn distance_m(&self, first: usize, second: usize, frames: &Frames, enough_m: f64) -> Option<f64> {
        let pose = |index: usize| Some(&frames.base_from_body[self.body(index)?]);
        let (a, b) = (self.fragments(first)?, self.fragments(second)?);
        Some(a.distance_m(pose(first)?, b, pose(second)?, enough_m))
    }

    /// Proves that two capsules' contents stay apart, by the capsules or by the convex hulls of their contents. For
    /// the plan's close pairs, and for parts that keep a posture, surfaces count too.
    pub fn prove(&self, first: usize, second: usize) -> Option<Proof> {
        let a = self.on_body(first, &self.capsules[first].shape)?;
        let b = self.on_body(second, &self.capsules[second].shape)?;
        if let Verdict::Clear { at_least_m } = prove(self.model, &a, &b, self.plan.clear_mm * 1e-3) {
            return Some(Proof { at_least_m, by: By::Capsules });
        }
        if self.plan.is_close(&a.name, &b.name) || self.keep_posture(first, second) {
            return self.prove_close(first, second);
        }
        self.prove_hulls(first, second, self.plan.clear_hull_mm * 1e-3)
    }

    /// Proves that the contents of two capsules that are built close never touch, by hulls or by their surfaces.
    pub fn prove_close(&self, first: usize, second: usize) -> Option<Proof> {
        let bound_m = self.plan.clear_close_mm * 1e-3;
        self.prove_hulls(first, second, bound_m).or_else(|| self.prove_fragments(first, second, bound_m))
    }

    fn prove_hulls(&self, first: usize, second: usize, bound_m: f64) -> Option<Proof> {
        let (body_a, body_b) = self.bodies(first, second, HULL_JOINTS_MAX)?;
        let (a, b) = (self.hull(first)?, self.hull(second)?);
        let (ball_a, ball_b) = (ball(&a.corners()), ball(&b.corners()));
        let (rough_a, rough_b) = (rough(a), rough(b));
        let distance = |frames: &Frames, enough_m: f64| {
            let (pose_a, pose_b) = (&frames.base_from_body[body_a], &frames.base_from_body[body_b]);
            let centers = pose_a.transform_point(&ball_a.0) - pose_b.transform_point(&ball_b.0);
            let mut apart_m = centers.norm() - ball_a.1 - ball_b.1;
            if let (false, Some((rough_a, off_a)), Some((rough_b, off_b))) = (apart_m > enough_m, &rough_a, &rough_b) {
                apart_m = rough_a.distance_m(pose_a, rough_b, pose_b) - off_a - off_b;
            }
            if apart_m > enough_m { apart_m } else { a.distance_m(pose_a, b, pose_b) }
        };
        let at_least_m = self.prove_by(first, second, bound_m, CELLS_MAX, &distance)?;
        Some(Proof { at_least_m, by: By::Hulls })
    }

    fn prove_fragments(&self, first: usize, second: usize, bound_m: f64) -> Option<Proof> {
        self.bodies(first, second, HULL_JOINTS_MAX)?;
        let distance = |frames: &Frames, enough_m| self.distance_m(first, second, frames, enough_m).unwrap_or(0.0);
        let at_least_m = self.prove_by(first, second, bound_m, FRAGMENT_CELLS_MAX, &distance)?;
        Some(Proof { at_least_m, by: By::Fragments })
    }

    /// Returns the bodies of a pair with at most this many deciding joints.
    fn bodies(&self, first: usize, second: usize, joints_max: usize) -> Option<(usize, usize)> {
        let (a, b) = (self.body(first)?, self.body(second)?);
        let (of_a, of_b) = deciding_joints(self.model, a, b);
        (of_a.len() + of_b.len() <= joints_max).then_some((a, b))
    }

    fn prove_by(
        &self,
        first: usize,
        second: usize,
        bound_m: f64,
        cells_max: usize,
        distance: &Distance<'_>,
    ) -> Option<f64> {
        let (corners_a, corners_b) = (self.hull(first)?.corners(), self.hull(second)?.corners());
        let part_a = Part { body: self.body(first)?, points: &corners_a };
        let part_b = Part { body: self.body(second)?, points: &corners_b };
        match prove_parts(self.model, [&part_a, &part_b], bound_m, cells_max, distance) {
            Verdict::Clear { at_least_m } => Some(at_least_m),
            Verdict::Meets { .. } | Verdict::Open => None,
        }
    }

    /// Proves that the surfaces of two capsules' contents overlap in every posture within the limits in force, or in one
    /// that moves them by no more than the clearance. So no command could keep it.
    pub fn prove_overlap(&self, first: usize, second: usize) -> bool {
        let proved = || {
            self.bodies(first, second, HULL_JOINTS_MAX)?;
            let (corners_a, corners_b) = (self.hull(first)?.corners(), self.hull(second)?.corners());
            let part_a = Part { body: self.body(first)?, points: &corners_a };
            let part_b = Part { body: self.body(second)?, points: &corners_b };
            let distance =
                |frames: &Frames, enough_m| self.distance_m(first, second, frames, enough_m).unwrap_or(f64::INFINITY);
            Some(prove_overlap(self.model, [&part_a, &part_b], self.model.d_min_m, FRAGMENT_CELLS_MAX, &distance))
        };
        proved().unwrap_or(false)
    }

    /// Returns true if only joints of the body are between two capsules that follow nobody. They keep a posture.
    pub fn keep_posture(&self, first: usize, second: usize) -> bool {
        let (Some(a), Some(b)) = (self.body(first), self.body(second)) else { return false };
        let (of_a, of_b) = deciding_joints(self.model, a, b);
        let of_head = |j: &usize| self.model.head.as_ref().is_some_and(|head| head.joints.contains(&Some(*j)));
        of_a.iter().chain(&of_b).all(|j| *j < self.model.body_count && !of_head(j))
    }

    /// Returns the reason why a pair needs no check. None if it needs one.
    pub fn decide(&self, first: usize, second: usize) -> Option<AllowedReason> {
        let (a, b) = (self.body(first)?, self.body(second)?);
        if a == b {
            return Some(AllowedReason::SameBody);
        }
        if self.model.parent_body(a) == Some(b) || self.model.parent_body(b) == Some(a) {
            return Some(AllowedReason::Adjacent);
        }
        if self.prove(first, second).is_some() {
            return Some(AllowedReason::ProvedClear);
        }
        self.prove_overlap(first, second).then_some(AllowedReason::OverlapAsPublished)
    }
}

/// Returns a ball around points: its centre and its radius, m.
fn ball(points: &[Vector3<f64>]) -> (Vector3<f64>, f64) {
    let center = points.iter().sum::<Vector3<f64>>() / points.len().max(1) as f64;
    (center, points.iter().map(|point| (point - center).norm()).fold(0.0, f64::max))
}

/// Returns the hull of fewer corners, one for each small cube, and the largest distance of a corner from the one that
/// stands for it, m. The whole hull lies within that distance of it. `None` if that would spare little.
fn rough(hull: &Hull) -> Option<(Hull, f64)> {
    let corners = hull.corners();
    let mut chosen: BTreeMap<[i64; 3], Vector3<f64>> = BTreeMap::new();
    let mut off_m = 0.0_f64;
    for corner in &corners {
        let cube = [0, 1, 2].map(|axis| (corner[axis] / CUBE_M).floor() as i64);
        off_m = off_m.max((*chosen.entry(cube).or_insert(*corner) - corner).norm());
    }
    let few: Vec<Vector3<f64>> = chosen.into_values().collect();
    if 2 * few.len() > corners.len() { None } else { Some((Hull::new(&few)?, off_m)) }
}
