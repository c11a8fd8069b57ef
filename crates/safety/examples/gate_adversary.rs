//! Attacks the gate for as many joint steps as asked: `cargo run --release -p safety --example gate_adversary -- 1e7`.

#[path = "../tests/support/mod.rs"]
mod support;

use support::adversary::Adversary;
use support::model;

fn main() {
    let steps: f64 = std::env::args().nth(1).and_then(|text| text.parse().ok()).unwrap_or(1e7);
    let ticks = (steps / messages::JOINTS as f64).ceil() as u64;
    let mut failed = false;
    for (name, with_pairs) in [("joints only", false), ("with self-collision", true)] {
        let mut model = model();
        if !with_pairs {
            model.pairs.clear();
        }
        let ticks = if with_pairs { ticks / 10 } else { ticks };
        let mut adversary = Adversary::new(&model, 1234);
        for _ in 0..ticks {
            adversary.step();
        }
        let mut report = adversary.report;
        let violations = report.violations.len();
        failed |= violations > 0;
        report.violations.truncate(1);
        println!("{name}: {} joint steps, {violations} violations, {report:?}", ticks * messages::JOINTS as u64);
    }
    std::process::exit(i32::from(failed));
}
