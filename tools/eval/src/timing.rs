//! Measures how long a method takes for one pose of both arms, on this machine, now.

use crate::clips::Human;
use crate::methods::{Posture, Solver};
use retarget::ArmModel;
use std::hint::black_box;
use std::time::Instant;

/// Length of one repetition, us. It is long enough that the clock's own cost does not count.
const REPETITION_US: f64 = 4_000.0;
/// Number of repetitions. Their median is reported, so that other work on the machine hardly counts.
const REPETITIONS: usize = 25;
/// Approximate time limit of each method, us.
const BUDGET_US: f64 = 400_000.0;

pub type Moment = (Human, Posture);

/// Returns microseconds per pose with batch 1: the median over repetitions, each over consecutive moments.
pub fn us_per_pose(solver: &Solver, arms: [&ArmModel; 2], moments: &[Moment]) -> Option<f64> {
    if moments.is_empty() {
        return None;
    }
    // Warm up, and measure the duration.
    let once = time_us(solver, arms, moments.iter().take(3)) / moments.len().min(3) as f64;
    let poses = ((REPETITION_US / once.max(0.1)) as usize).clamp(1, 20_000);
    let repetitions = ((BUDGET_US / (once.max(0.1) * poses as f64)) as usize).clamp(3, REPETITIONS);
    let mut measured: Vec<f64> = (0..repetitions)
        .map(|repetition| {
            let row = moments.iter().cycle().skip(repetition * poses % moments.len()).take(poses);
            time_us(solver, arms, row) / poses as f64
        })
        .collect();
    measured.sort_by(f64::total_cmp);
    measured.get(measured.len() / 2).copied()
}

fn time_us<'a>(solver: &Solver, arms: [&ArmModel; 2], moments: impl Iterator<Item = &'a Moment>) -> f64 {
    let start = Instant::now();
    for (human, previous) in moments {
        black_box(solver.pose(arms, black_box(human), black_box(previous)));
    }
    start.elapsed().as_secs_f64() * 1e6
}
