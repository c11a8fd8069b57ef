//! Times whole ticks of the gate and of the state machine: `cargo run --release -p safety --example tick_times`.

#[path = "../tests/support/mod.rs"]
mod support;

use std::time::Instant;

use messages::Stamp;
use safety::gate::{Config, Proposed, State, tick};
use support::motion::{T, joint, resting, set_joint, stop_from, store};
use support::{Bench, model};

/// Joints of TIAGo++.
const JOINTS: usize = 17;

fn main() {
    const TICKS: u64 = 100_000;
    let model = model();
    let config = Config::new(&model).expect("the robot of the repository is allowed");
    let mut gate = State::at_rest(model.home);
    let mut bench = Bench::engaged();
    let (mut gate_ns, mut engage_ns) = (Vec::new(), Vec::new());
    let mut accepted = 0;
    let mut last = resting(0, model.home);
    for k in 1..=TICKS {
        // All joints swing by a little, so that every tick is a new motion with both clearance checks.
        let mut next = resting(k, last.motion.q);
        for j in 0..JOINTS {
            let share = 0.02 * if (k / 15) % 4 == 0 || (k / 15) % 4 == 3 { 1.0 } else { -1.0 };
            let to = joint(&last, j).after(share * model.limits[j].j_max, T);
            set_joint(&mut next, j, to);
            store(&mut next.motion.plan, j, &stop_from(to, model.limits[j].a_max, model.limits[j].j_max));
        }
        let start = Instant::now();
        let decision = tick(&config, &mut gate, Stamp(0), next);
        gate_ns.push(start.elapsed().as_nanos() as u64);
        accepted += u64::from(decision.accepted());
        let start = Instant::now();
        bench.step();
        engage_ns.push(start.elapsed().as_nanos() as u64);
        last = Proposed { motion: decision.motion, ..resting(k, decision.motion.q) };
    }
    for (name, mut times) in [("gate", gate_ns), ("engage", engage_ns)] {
        times.sort_unstable();
        let at = |share: f64| times[((times.len() - 1) as f64 * share) as usize] as f64 / 1e3;
        println!("{name}: p50 {:.1} us, p99 {:.1} us, p99.99 {:.1} us", at(0.5), at(0.99), at(0.9999));
    }
    println!("{accepted} of {TICKS} ticks accepted");
}
