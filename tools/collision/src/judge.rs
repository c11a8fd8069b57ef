//! Decides which pairs need no check, by proof.

use crate::fit::Shape;
use crate::fragments::Fragments;
use crate::plan::Plan;
use crate::prove::{CELLS_MAX, Part, Verdict, deciding_joints, prove, prove_parts};
use crate::write::Named;
use robot::{AllowedReason, Capsule, Frames, Hull, Model};
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

    /// Returns the distance of two capsules' contents, by fragments, m.
    pub fn distance_m(&self, first: usize, second: usize, frames: &Frames) -> Option<f64> {
        let pose = |index: usize| Some(&frames.base_from_body[self.body(index)?]);
        let (a, b) = (self.fragments(first)?, self.fragments(second)?);
        Some(a.distance_m(pose(first)?, b, pose(second)?))
    }

    /// Proves that two capsules' contents stay apart, by the capsules or by the convex hulls of their contents. For
    /// the plan's close pairs, surfaces count too.
    pub fn prove(&self, first: usize, second: usize) -> Option<Proof> {
        let a = self.on_body(first, &self.capsules[first].shape)?;
        let b = self.on_body(second, &self.capsules[second].shape)?;
        if let Verdict::Clear { at_least_m } = prove(self.model, &a, &b, self.plan.clear_mm * 1e-3) {
            return Some(Proof { at_least_m, by: By::Capsules });
        }
        if self.plan.is_close(&a.name, &b.name) {
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
        let distance = |frames: &Frames| {
            let pose = |body: usize| &frames.base_from_body[body];
            a.distance_m(pose(body_a), b, pose(body_b))
        };
        let at_least_m = self.prove_by(first, second, bound_m, CELLS_MAX, &distance)?;
        Some(Proof { at_least_m, by: By::Hulls })
    }

    fn prove_fragments(&self, first: usize, second: usize, bound_m: f64) -> Option<Proof> {
        self.bodies(first, second, HULL_JOINTS_MAX)?;
        let distance = |frames: &Frames| self.distance_m(first, second, frames).unwrap_or(0.0);
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
        distance: &dyn Fn(&Frames) -> f64,
    ) -> Option<f64> {
        let (corners_a, corners_b) = (self.hull(first)?.corners(), self.hull(second)?.corners());
        let part_a = Part { body: self.body(first)?, points: &corners_a };
        let part_b = Part { body: self.body(second)?, points: &corners_b };
        match prove_parts(self.model, &part_a, &part_b, bound_m, cells_max, distance) {
            Verdict::Clear { at_least_m } => Some(at_least_m),
            Verdict::Meets { .. } | Verdict::Open => None,
        }
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
        self.prove(first, second).map(|_| AllowedReason::ProvedClear)
    }
}
