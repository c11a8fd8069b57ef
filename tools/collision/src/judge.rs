//! Decides which pairs need no check, by proof.

use crate::content::Solid;
use crate::fit::Shape;
use crate::fragments::Fragments;
use crate::plan::Plan;
use crate::prove::{CELLS_MAX, Distance, Part, Verdict, deciding_joints, prove, prove_overlap, prove_parts};
use crate::write::Named;
use robot::{AllowedReason, Capsule, Frames, Model};
use std::fmt;

/// Decides about pairs.
pub struct Judge<'a> {
    model: &'a Model,
    plan: &'a Plan,
    capsules: &'a [Named],
}

/// Largest number of deciding joints for which a proof by hulls is tried: parts of one shoulder or wrist, or a
/// neck.
pub(crate) const HULL_JOINTS_MAX: usize = 3;
/// Largest number of cells that a proof by fragments may visit. Their distances are slow.
const FRAGMENT_CELLS_MAX: usize = 20_000;
/// The same for joints that move: their ranges are worth more time.
const MOVING_CELLS_MAX: usize = 60_000;

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Proof {
    /// They stay at least this far apart, m.
    pub at_least_m: f64,
    /// The bodies whose distance was judged.
    pub by: &'static str,
}

impl fmt::Display for Proof {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "at least {:.1} mm ({})", self.at_least_m * 1e3, self.by)
    }
}

impl<'a> Judge<'a> {
    pub fn new(model: &'a Model, plan: &'a Plan, capsules: &'a [Named]) -> Self {
        Self { model, plan, capsules }
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

    fn solid(&self, index: usize) -> Option<&Solid> {
        let named = &self.capsules[index];
        named.content.solid(&self.model.link_body(&named.link)?.1)
    }

    fn fragments(&self, index: usize) -> Option<&Fragments> {
        let named = &self.capsules[index];
        named.content.fragments(&self.model.link_body(&named.link)?.1)
    }

    /// Returns the distance of two capsules' contents, by fragments, m. The bounds are those of [`Distance`].
    pub fn distance_m(&self, first: usize, second: usize, frames: &Frames, bounds_m: [f64; 2]) -> Option<f64> {
        let pose = |index: usize| Some(&frames.base_from_body[self.body(index)?]);
        let (a, b) = (self.fragments(first)?, self.fragments(second)?);
        Some(a.distance_m(pose(first)?, b, pose(second)?, bounds_m))
    }

    /// Proves that two capsules' contents stay apart, by the capsules or by the convex hulls of their contents. For
    /// the plan's close pairs, and for parts that keep a posture, surfaces count too.
    pub fn prove(&self, first: usize, second: usize) -> Option<Proof> {
        let a = self.on_body(first, &self.capsules[first].shape)?;
        let b = self.on_body(second, &self.capsules[second].shape)?;
        if let Verdict::Clear { at_least_m } = prove(self.model, &a, &b, self.plan.clear_mm * 1e-3) {
            return Some(Proof { at_least_m, by: "capsules" });
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
        let (a, b) = (self.solid(first)?, self.solid(second)?);
        let distance = |frames: &Frames, bounds_m| {
            a.distance_m(&frames.base_from_body[body_a], b, &frames.base_from_body[body_b], bounds_m)
        };
        let at_least_m = self.prove_by(first, second, bound_m, CELLS_MAX, &distance)?;
        Some(Proof { at_least_m, by: "convex hulls" })
    }

    fn prove_fragments(&self, first: usize, second: usize, bound_m: f64) -> Option<Proof> {
        self.bodies(first, second, HULL_JOINTS_MAX)?;
        let distance = |frames: &Frames, bounds_m| self.distance_m(first, second, frames, bounds_m).unwrap_or(0.0);
        let cells_max = if self.keep_posture(first, second) { FRAGMENT_CELLS_MAX } else { MOVING_CELLS_MAX };
        let at_least_m = self.prove_by(first, second, bound_m, cells_max, &distance)?;
        Some(Proof { at_least_m, by: "surfaces" })
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
        let part_a = Part { body: self.body(first)?, points: &self.solid(first)?.cloud };
        let part_b = Part { body: self.body(second)?, points: &self.solid(second)?.cloud };
        match prove_parts(self.model, [&part_a, &part_b], bound_m, cells_max, distance) {
            Verdict::Clear { at_least_m } => Some(at_least_m),
            Verdict::Meets { .. } | Verdict::Open => None,
        }
    }

    /// Proves that the surfaces of two capsules' contents touch in every posture within the limits in force, or in one that
    /// moves them by no more than the clearance. They touch if no proof could tell them apart. So no command could keep it.
    pub fn prove_overlap(&self, first: usize, second: usize) -> bool {
        let proved = || {
            self.bodies(first, second, HULL_JOINTS_MAX)?;
            let part_a = Part { body: self.body(first)?, points: &self.solid(first)?.cloud };
            let part_b = Part { body: self.body(second)?, points: &self.solid(second)?.cloud };
            let distance =
                |frames: &Frames, bounds_m| self.distance_m(first, second, frames, bounds_m).unwrap_or(f64::INFINITY);
            let bounds_m = [self.plan.clear_close_mm * 1e-3, self.model.d_min_m];
            Some(prove_overlap(self.model, [&part_a, &part_b], bounds_m, FRAGMENT_CELLS_MAX, &distance))
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
