//! How well any motion of an arm could have followed: the smallest mean limb error that is found, looking ahead, within
//! given positions, speeds and accelerations. Collisions, torques and jerk are not asked for.
//!
//! Three searches by least squares go through the path in windows, each begun with what the window before left over, and keep
//! the part of which the rest looks ahead: [`least_squares`] is the best of the three. [`optimum`] improves it over its whole
//! length, by the angles themselves. What is found can be executed; the true optimum is that or less.

use super::riccati::Joints;
use super::tracking::{Bounds, Loss, Motion, State, Task};
use retarget::{ArmModel, Limbs, limb_error_deg};

/// Nodes of a window, and how many of them are kept: 2 s and 1 s, 1 s and 0.5 s, 0.5 s and 0.1 s.
const WINDOWS: [(usize, usize); 3] = [(100, 50), (50, 25), (25, 5)];

/// A motion of one arm from the start, which belongs to the first of the path; its states belong to the others.
#[must_use]
pub fn least_squares(arm: &ArmModel, bounds: &Bounds, path: &[Limbs], start: State) -> Motion {
    let Some(goal) = path.get(1..) else { return Motion::from(start, Vec::new()) };
    let task = Task { arm, bounds, goal, start };
    let found = WINDOWS.map(|(nodes, kept)| search(&task, nodes, kept));
    let best = found.into_iter().map(|motion| (error_deg(arm, &motion, goal), motion));
    best.reduce(|a, b| if b.0 < a.0 { b } else { a }).map_or(Motion::from(start, Vec::new()), |(_, best)| best)
}

/// As [`least_squares`], and better.
#[must_use]
pub fn optimum(arm: &ArmModel, bounds: &Bounds, path: &[Limbs], start: State) -> Motion {
    improved(arm, bounds, path, start, least_squares(arm, bounds, path, start))
}

/// A motion from `start`, with less of the angles themselves if that can be.
#[must_use]
pub fn improved(arm: &ArmModel, bounds: &Bounds, path: &[Limbs], start: State, best: Motion) -> Motion {
    let goal = path.get(1..).unwrap_or_default();
    let task = Task { arm, bounds, goal, start };
    let bounds = task.bounds_around(&best);
    let polished = Task { bounds: &bounds, ..task }.improve(best.clone(), Loss::Angle);
    if error_deg(arm, &polished, goal) < error_deg(arm, &best, goal) { polished } else { best }
}

/// Sum of both limbs' angles over all nodes, degrees.
#[must_use]
pub fn error_deg(arm: &ArmModel, motion: &Motion, goal: &[Limbs]) -> f64 {
    let nodes = motion.states.iter().zip(goal);
    nodes.map(|(state, goal)| limb_error_deg(&arm.forward(&state.q.into()), goal).iter().sum::<f64>()).sum()
}

fn search(whole: &Task<'_>, nodes: usize, kept: usize) -> Motion {
    let mut all: Vec<Joints> = Vec::with_capacity(whole.goal.len());
    let (mut at, mut left) = (whole.start, Vec::new());
    while all.len() < whole.goal.len() {
        let rest = &whole.goal[all.len()..];
        let goal = &rest[..nodes.min(rest.len())];
        let guess = Motion::from(at, extended(at, left, goal.len(), whole.bounds));
        let task = Task { goal, start: at, ..*whole };
        let bounds = task.bounds_around(&guess);
        let mut found = Task { bounds: &bounds, ..task }.improve(guess, Loss::Square);
        let kept = if goal.len() == rest.len() { goal.len() } else { kept };
        at = found.states[kept - 1];
        left = found.a.split_off(kept);
        all.append(&mut found.a);
    }
    Motion::from(whole.start, all)
}

/// These accelerations from `at`, and after them a stop.
fn extended(at: State, mut a: Vec<Joints>, nodes: usize, bounds: &Bounds) -> Vec<Joints> {
    let mut at = a.iter().fold(at, |at, a| at.after(a));
    while a.len() < nodes {
        let brake = at.brake(bounds);
        at = at.after(&brake);
        a.push(brake);
    }
    a
}
