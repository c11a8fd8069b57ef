//! Attacks the gate for a given number of joint steps, on all cores: `cargo run --release -p safety --example
//! gate_adversary -- 1e7 [threads] [seed]`. Then it attacks for a tenth as many steps with self-collision. It
//! fails on a violation, or if a sound proposal was denied.

#[path = "../tests/support/mod.rs"]
mod support;

use std::thread;
use std::time::Instant;

use robot::Model;
use support::adversary::{Adversary, Report};
use support::{JOINTS, model};

/// Returns the `n`th argument as a number, or `otherwise`.
fn argument(n: usize, otherwise: f64) -> f64 {
    let Some(text) = std::env::args().nth(n) else { return otherwise };
    match text.parse() {
        Ok(number) if (0.0..1e15).contains(&number) => number,
        _ => {
            eprintln!("{text}: must be a number in [0, 1e15)");
            std::process::exit(2);
        }
    }
}

/// Attacks for `ticks` ticks and returns the report. The attack ends after 100 violations, so that a gate
/// that fails often cannot fill the memory.
fn attack(model: &Model, seed: u64, ticks: u64) -> Report {
    let mut adversary = Adversary::new(model, seed);
    for _ in 0..ticks {
        adversary.step();
        if adversary.report.violations.len() > 100 {
            break;
        }
    }
    adversary.report
}

fn main() {
    let cores = thread::available_parallelism().map_or(1, usize::from);
    let steps = argument(1, 1e7);
    let threads = argument(2, cores as f64).max(1.0) as u64;
    let seed = argument(3, 1234.0) as u64;
    let mut failed = false;
    for (name, with_pairs, share) in [("joints only", false, 1.0), ("with self-collision", true, 0.1)] {
        let mut model = model();
        if !with_pairs {
            model.pairs.clear();
        }
        let ticks = (share * steps / JOINTS as f64 / threads as f64).ceil() as u64;
        let start = Instant::now();
        let reports: Vec<Report> = thread::scope(|scope| {
            let model = &model;
            let attacks: Vec<_> =
                (0..threads).map(|n| scope.spawn(move || attack(model, seed.wrapping_add(n), ticks))).collect();
            attacks.into_iter().map(|attack| attack.join().expect("an attack ends with a report")).collect()
        });
        let mut total = Report::default();
        for report in &reports {
            total.add(report);
        }
        let violations = total.violations.len();
        failed |= violations > 0 || total.honest_denied > 0;
        total.violations.truncate(1);
        println!(
            "{name}: {} joint steps on {threads} threads in {:.0} s, {violations} violations, {total:?}",
            total.ticks * JOINTS as u64,
            start.elapsed().as_secs_f64()
        );
    }
    std::process::exit(i32::from(failed));
}
