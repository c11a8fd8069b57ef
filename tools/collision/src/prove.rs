//! Proves that two capsules cannot meet anywhere in the box of the position limits, or finds where they do.

use crate::content::Cloud;
use messages::JOINTS_MAX;
use nalgebra::Vector3;
use rand::{RngExt, SeedableRng};
use robot::{Capsule, Frames, Model, segment_distance};

/// Result for a pair over all joint positions within the limits in force. No command leaves these limits.
#[derive(Clone, Debug, PartialEq)]
pub enum Verdict {
    /// Never closer than this, m. It is proved for every configuration.
    Clear {
        at_least_m: f64,
    },
    /// Closer than the bound in a configuration that was found.
    Meets {
        clearance_m: f64,
    },
    Open,
}

/// Random configurations per deciding joint before a proof is tried. They are cheap where many joints make
/// proofs expensive.
const SAMPLES_PER_JOINT: usize = 20;
/// Least number of them (chosen). A pair that touches seldom would else cost a whole failed proof.
const SAMPLES_MIN: usize = 400;
/// Number of the nearest random configurations from which a search goes on to nearer ones (chosen).
const STARTS: usize = 4;
/// First step of that search, as a share of a joint's range. It is halved down to the last (chosen).
const STEP_SHARES: [f64; 2] = [0.25, 0.01];
/// Largest number of cells of the joint box that a proof may visit.
pub const CELLS_MAX: usize = 200_000;

/// Returns the joints that move `body` relative to the base, from the base outward.
fn chain(model: &Model, body: usize) -> Vec<usize> {
    let mut joints = Vec::new();
    let mut at = body;
    while let Some(parent) = model.parent_body(at) {
        joints.push(at - 1);
        at = parent;
    }
    joints.reverse();
    joints
}

/// Returns the joints that determine the relative pose of two bodies.
pub fn deciding_joints(model: &Model, a: usize, b: usize) -> (Vec<usize>, Vec<usize>) {
    let (mut a, mut b) = (chain(model, a), chain(model, b));
    let common = a.iter().zip(&b).take_while(|(x, y)| x == y).count();
    (a.split_off(common), b.split_off(common))
}

pub fn clearance(frames: &Frames, a: &Capsule, b: &Capsule) -> f64 {
    let ([a0, a1], [b0, b1]) = (a.ends(frames), b.ends(frames));
    segment_distance(&a0, &a1, &b0, &b1).distance_m - a.radius_m - b.radius_m
}

/// A moving part: the convex hull of points of a body.
#[derive(Clone, Copy)]
pub struct Part<'a> {
    pub body: usize,
    /// Points in the body's frame, m.
    pub points: &'a Cloud,
}

/// Distance of two parts in a configuration, m, and two bounds. If it is above the second one, any lower bound above that will do.
/// If it is not above the first one, any upper bound not above that will do. Between them, any value between them will do. If the
/// first one is minus infinity, a distance up to the second one is exact.
pub type Distance<'a> = dyn Fn(&Frames, [f64; 2]) -> f64 + 'a;

/// Decides whether two capsules are always farther apart than `clear_m`.
pub fn prove(model: &Model, a: &Capsule, b: &Capsule, clear_m: f64) -> Verdict {
    let (of_a, of_b) = (Cloud::new(vec![a.a, a.b]), Cloud::new(vec![b.a, b.b]));
    let (a_part, b_part) = (Part { body: a.body, points: &of_a }, Part { body: b.body, points: &of_b });
    prove_parts(model, [&a_part, &b_part], clear_m, CELLS_MAX, &|frames, _| clearance(frames, a, b))
}

/// Positions of the deciding joints of two parts, in their order. Those of all other joints do not matter.
type Positions = [f64; JOINTS_MAX];

/// Fate of a cell whose middle was looked at.
enum Step {
    Done,
    Halve,
    Stop,
}

/// Two parts, and the joints that determine how they lie to each other.
struct Between<'a> {
    model: &'a Model,
    parts: [&'a Part<'a>; 2],
    /// The joints of the first part from the base outward, then those of the second.
    joints: Vec<usize>,
    /// Number of joints of the first part.
    first: usize,
    axes: Vec<Vector3<f64>>,
    frames: Frames,
    distance: &'a Distance<'a>,
}

impl<'a> Between<'a> {
    fn new(model: &'a Model, parts: [&'a Part<'a>; 2], distance: &'a Distance<'a>) -> Self {
        let (of_a, of_b) = deciding_joints(model, parts[0].body, parts[1].body);
        let joints: Vec<usize> = of_a.iter().chain(&of_b).copied().collect();
        let axes = joints.iter().map(|j| model.joint_at_zero(*j).1).collect();
        let mut frames = Frames::default();
        model.forward(&model.home, &mut frames);
        Self { model, parts, joints, first: of_a.len(), axes, frames, distance }
    }

    fn limits(&self, i: usize) -> (f64, f64) {
        let limits = &self.model.limits[self.joints[i]];
        (limits.q_min, limits.q_max)
    }

    fn place(&mut self, q: &Positions) {
        for (j, q) in self.joints.iter().zip(q) {
            self.model.forward_joint(*j, *q, &mut self.frames);
        }
    }

    fn distance_m(&mut self, q: &Positions, enough_m: f64) -> f64 {
        self.place(q);
        (self.distance)(&self.frames, [f64::NEG_INFINITY, enough_m])
    }

    /// Looks for a configuration in which the parts are not farther apart than `clear_m`: random ones, then nearer ones
    /// from the nearest. Returns the distance there, m.
    fn meeting_m(&mut self, clear_m: f64) -> Option<f64> {
        let mut rng = rand_pcg::Pcg64::seed_from_u64(1);
        let mut nearest = vec![(f64::INFINITY, [0.0; JOINTS_MAX]); STARTS];
        for _ in 0..SAMPLES_MIN.max(SAMPLES_PER_JOINT * self.joints.len() * self.joints.len()) {
            let mut q = [0.0; JOINTS_MAX];
            for (i, q) in q.iter_mut().enumerate().take(self.joints.len()) {
                let (low, high) = self.limits(i);
                *q = rng.random_range(low..high);
            }
            let distance_m = self.distance_m(&q, nearest[STARTS - 1].0);
            if distance_m <= clear_m {
                return Some(distance_m);
            }
            if distance_m < nearest[STARTS - 1].0 {
                nearest[STARTS - 1] = (distance_m, q);
                nearest.sort_by(|a, b| a.0.total_cmp(&b.0));
            }
        }
        nearest.retain(|(distance_m, _)| distance_m.is_finite());
        nearest.into_iter().find_map(|(distance_m, q)| self.nearer_m(distance_m, q, clear_m))
    }

    /// Moves one joint after the other, as long as the parts come nearer, in ever smaller steps. Returns the distance where
    /// it is not above `clear_m`.
    fn nearer_m(&mut self, mut least_m: f64, mut q: Positions, clear_m: f64) -> Option<f64> {
        let mut share = STEP_SHARES[0];
        while share > STEP_SHARES[1] && least_m > clear_m {
            let start_m = least_m;
            for (i, sign) in (0..self.joints.len()).flat_map(|i| [(i, -1.0), (i, 1.0)]) {
                let ((low, high), before) = (self.limits(i), q[i]);
                q[i] = (before + sign * share * (high - low)).clamp(low, high);
                let distance_m = self.distance_m(&q, least_m);
                if distance_m < least_m {
                    least_m = distance_m;
                } else {
                    q[i] = before;
                }
            }
            if least_m >= start_m {
                share *= 0.5;
            }
        }
        (least_m <= clear_m).then_some(least_m)
    }

    /// Visits cells of the box of the limits in force, and halves each across the joint that moves the parts most, until
    /// all are done. Returns false after `cells_max` cells, or if a step stops it.
    fn visit(&mut self, cells_max: usize, step: &mut dyn FnMut(&Frames, f64) -> Step) -> bool {
        let count = self.joints.len();
        let mut whole = [(0.0, 0.0); JOINTS_MAX];
        for (i, range) in whole.iter_mut().enumerate().take(count) {
            *range = self.limits(i);
        }
        let mut open = vec![whole];
        for _ in 0..cells_max {
            let Some(cell) = open.pop() else { return true };
            self.place(&cell.map(|(low, high): (f64, f64)| 0.5 * (low + high)));
            let (drift_m, alone_m) = self.drift(&cell.map(|(low, high)| 0.5 * (high - low)));
            match step(&self.frames, drift_m) {
                Step::Done => continue,
                Step::Stop => return false,
                Step::Halve => {}
            }
            let Some(at) = (0..count).max_by(|x, y| alone_m[*x].total_cmp(&alone_m[*y])) else { return false };
            let (low, high) = cell[at];
            for range in [(low, 0.5 * (low + high)), (0.5 * (low + high), high)] {
                let mut part = cell;
                part[at] = range;
                open.push(part);
            }
        }
        false
    }

    /// Returns how far points of both parts can move relative to the common ancestor, m, if the joints leave the frames'
    /// configuration by at most their half widths. And for each joint how far it moves them alone.
    ///
    /// It goes from the far end inward. Turning joint j by h moves a point at distance p from its axis by at most h
    /// p. The joints beyond j may have moved it by D before, so p grows by D. A prismatic joint adds h. The
    /// distance from an axis is convex, so the bound for the points holds for their convex hull.
    fn drift(&self, half: &Positions) -> (f64, Positions) {
        let (mut sum, mut alone) = (0.0, [0.0; JOINTS_MAX]);
        for (part, joints) in self.parts.iter().zip([0..self.first, self.first..self.joints.len()]) {
            let pose = &self.frames.base_from_body[part.body];
            let mut moved = 0.0;
            for i in joints.rev() {
                let (j, half) = (self.joints[i], half[i]);
                let body = &self.frames.base_from_body[j + 1];
                // The distance from the axis is the same in the part's own frame.
                let axis = pose.r.tr_mul(&(body.r * self.axes[i]));
                let origin = pose.r.tr_mul(&(body.t - pose.t));
                let far = part.points.farthest_m(&axis, &origin);
                let slides = self.model.prismatic[j];
                alone[i] = if slides { half } else { half * far };
                moved += if slides { half } else { half * (far + moved) };
            }
            sum += moved;
        }
        (sum, alone)
    }
}

/// Decides whether the clearance of two parts is always above `clear_m`. The proof visits at most `cells_max` cells.
///
/// Branch and bound over the box of the limits in force. A cell is done if the clearance in its middle is
/// enough, less all that both parts can move inside the cell.
pub fn prove_parts(
    model: &Model,
    parts: [&Part<'_>; 2],
    clear_m: f64,
    cells_max: usize,
    distance: &Distance<'_>,
) -> Verdict {
    let mut between = Between::new(model, parts, distance);
    if let Some(clearance_m) = between.meeting_m(clear_m) {
        return Verdict::Meets { clearance_m };
    }
    let (mut at_least_m, mut meeting) = (f64::INFINITY, None);
    let done = between.visit(cells_max, &mut |frames, drift_m| {
        // One bound for both: what the distance was asked for, and what ends a cell.
        let enough_m = clear_m + drift_m;
        let middle_m = distance(frames, [clear_m, enough_m]);
        if middle_m <= clear_m {
            meeting = Some(middle_m);
            return Step::Stop;
        }
        if middle_m > enough_m {
            at_least_m = at_least_m.min(middle_m - drift_m);
            return Step::Done;
        }
        Step::Halve
    });
    match meeting {
        Some(clearance_m) => Verdict::Meets { clearance_m },
        None if done => Verdict::Clear { at_least_m },
        None => Verdict::Open,
    }
}

/// Proves that two parts are not farther apart than `touch_m` in every posture, or in one that moves them by at most `reach_m`.
/// The proof visits at most `cells_max` cells.
pub fn prove_overlap(
    model: &Model,
    parts: [&Part<'_>; 2],
    [touch_m, reach_m]: [f64; 2],
    cells_max: usize,
    distance: &Distance<'_>,
) -> bool {
    Between::new(model, parts, distance).visit(cells_max, &mut |frames, drift_m| {
        if distance(frames, [touch_m, touch_m]) > touch_m {
            return Step::Stop;
        }
        if drift_m <= reach_m { Step::Done } else { Step::Halve }
    })
}
