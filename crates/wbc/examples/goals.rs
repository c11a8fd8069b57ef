//! Sends the robot to random postures that are clear of themselves and counts the ones it reaches within 8 s:
//! `goals --goals N --seed S [--robot FILE]`. Each goal starts where the one before it ended.

#[path = "../tests/support/mod.rs"]
mod support;

use messages::{ALL_JOINTS, JOINTS, Stamp};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use support::Subject;
use wbc::{Input, Options, Permit, State, Target, certify_rest, tick};

/// 8 s of ticks.
const PATIENCE: u64 = 12_000;

fn text(name: &str) -> Option<String> {
    let mut arguments = std::env::args();
    arguments.find(|a| a == name).and_then(|_| arguments.next())
}

fn number(name: &str, default: u64) -> u64 {
    text(name).map_or(default, |text| text.parse().unwrap_or_else(|_| panic!("{name} {text}: not a number")))
}

fn main() {
    let subject = text("--robot").map_or_else(Subject::made_up, |path| Subject::load(&path));
    let config = subject.config(Options::default());
    let mut rng = Pcg64::seed_from_u64(number("--seed", 1));
    let mut state = State::at_rest(&config, subject.home);
    let (goals, mut reached, mut returned, mut tried) = (number("--goals", 100), 0, 0, 0);
    let go = |state: &mut State, q: &[f64; JOINTS]| {
        let target = Target { q, dq: &[0.0; JOINTS], valid_mask: ALL_JOINTS };
        let permit = Permit::Follow { speed_scale: 1.0 };
        let mut last = None;
        let reached = (0..PATIENCE).any(|k| {
            let out = tick(&config, state, Stamp::NONE, Input { k, target: Some(target), permit });
            last = Some(out);
            out.on_target && out.at_rest
        });
        if let Some(out) = last.filter(|_| !reached) {
            let off = (0..JOINTS).fold(0.0_f64, |most, j| most.max((out.q[j] - q[j]).abs()));
            let [a, b] = out.nearest_pair;
            let mm = out.clearance_m * 1e3;
            println!(
                "missed by {off:.3}: capsules {a} and {b} {mm:.3} mm apart, {:?}, at rest {}",
                out.candidate, out.at_rest
            );
        }
        reached
    };
    while tried < goals {
        let mut q = subject.limits.map(|l| rng.random_range(l.q_min..=l.q_max));
        // The lift is too slow for 8 s over its whole range; the head is not what this is about.
        q[..3].copy_from_slice(&subject.home[..3]);
        if !certify_rest(&config, &q).0 {
            continue;
        }
        tried += 1;
        reached += u64::from(go(&mut state, &q));
        returned += u64::from(go(&mut state, &subject.home));
    }
    println!("{reached} of {goals} goals reached within 8 s, {returned} times back home within 8 s");
}
