//! Finds how well any motion of an arm could have followed. The result is the smallest mean limb error that is found,
//! looking ahead, within given positions, speeds and accelerations. Collisions, torques and jerk are not considered.
//!
//! Three searches by least squares go through the path in windows. Each window begins with the remainder of the
//! previous one, and keeps its first part. The rest of the window serves to look ahead. [`least_squares`] is
//! the best of the three. [`optimum`] improves it over its whole length, by the angles themselves. The
//! resulting motion can be executed. The true optimum has the same error or less.

use super::riccati::Joints;
use super::tracking::{Loss, Motion, NODE_S, Task, brake};
use follow::solver::{Bounds, State};
use retarget::{ArmModel, Limbs};

/// Nodes of a window, and the number of nodes that are kept. The times are 2 s and 1 s, 1 s and 0.5 s, 0.5 s and 0.1 s.
const WINDOWS: [(usize, usize); 3] = [(100, 50), (50, 25), (25, 5)];

/// Returns a motion of one arm from the start. The start belongs to the first limbs of the path, and the
/// motion's states to the others.
pub fn least_squares(arm: &ArmModel, bounds: &Bounds, path: &[Limbs], start: State) -> Motion {
    let Some(goal) = path.get(1..) else { return Motion::from(start, Vec::new()) };
    let task = Task { arm, bounds, goal, start };
    let found = WINDOWS.map(|window| search(&task, window, Loss::Square));
    let best = found.into_iter().map(|motion| (error_deg(arm, &motion, goal), motion));
    best.reduce(|a, b| if b.0 < a.0 { b } else { a }).map_or(Motion::from(start, Vec::new()), |(_, best)| best)
}

pub fn optimum(arm: &ArmModel, bounds: &Bounds, path: &[Limbs], start: State) -> Motion {
    improved(arm, bounds, path, start, least_squares(arm, bounds, path, start))
}

/// Returns a motion from `start` with a smaller sum of the angles themselves, if one is found.
pub fn improved(arm: &ArmModel, bounds: &Bounds, path: &[Limbs], start: State, best: Motion) -> Motion {
    let goal = path.get(1..).unwrap_or_default();
    let task = Task { arm, bounds, goal, start };
    let bounds = task.bounds_around(&best);
    let polished = Task { bounds: &bounds, ..task }.improve(best.clone(), Loss::Angle);
    if error_deg(arm, &polished, goal) < error_deg(arm, &best, goal) { polished } else { best }
}

/// Returns the sum of both limbs' angles over all nodes, degrees.
pub fn error_deg(arm: &ArmModel, motion: &Motion, goal: &[Limbs]) -> f64 {
    let nodes = motion.states.iter().zip(goal);
    nodes.map(|(state, goal)| arm.limb_error_deg(&state.q.into(), goal).iter().sum::<f64>()).sum()
}

fn search(whole: &Task<'_>, (nodes, kept): (usize, usize), loss: Loss) -> Motion {
    let mut all: Vec<Joints> = Vec::with_capacity(whole.goal.len());
    let (mut at, mut left) = (whole.start, Vec::new());
    while all.len() < whole.goal.len() {
        let rest = &whole.goal[all.len()..];
        let goal = &rest[..nodes.min(rest.len())];
        let guess = Motion::from(at, extended(at, left, goal.len(), whole.bounds));
        let task = Task { goal, start: at, ..*whole };
        let bounds = task.bounds_around(&guess);
        let mut found = Task { bounds: &bounds, ..task }.improve(guess, loss);
        let kept = if goal.len() == rest.len() { goal.len() } else { kept };
        at = found.states[kept - 1];
        left = found.a.split_off(kept);
        all.append(&mut found.a);
    }
    Motion::from(whole.start, all)
}

fn extended(at: State, mut a: Vec<Joints>, nodes: usize, bounds: &Bounds) -> Vec<Joints> {
    let mut at = a.iter().fold(at, |at, a| at.after(a, NODE_S));
    while a.len() < nodes {
        let brake = brake(&at, bounds);
        at = at.after(&brake, NODE_S);
        a.push(brake);
    }
    a
}
