//! Attacks the stage for many ticks and judges every command: `adversarial --ticks N --seed S [--robot FILE]
//! [--dense EVERY] [--without-certificate] [--smooth]`. Exits with 1 if a guarantee was broken.

#[path = "../tests/support/mod.rs"]
mod support;

use judge::{Attacker, Checker, Robot};
use messages::Stamp;
use rand::SeedableRng;
use rand_pcg::Pcg64;
use std::time::Instant;
use support::{config_of, input, made_up};
use wbc::{Candidate, Options, State, tick};

fn text(name: &str) -> Option<String> {
    let mut arguments = std::env::args();
    arguments.find(|a| a == name).and_then(|_| arguments.next())
}

fn number(name: &str, default: u64) -> u64 {
    text(name).map_or(default, |text| text.parse().unwrap_or_else(|_| panic!("{name} {text}: not a number")))
}

fn flag(name: &str) -> bool {
    std::env::args().any(|a| a == name)
}

fn main() {
    let (ticks, seed, dense) = (number("--ticks", 100_000), number("--seed", 1), number("--dense", 500));
    let options =
        if flag("--without-certificate") { Options::without_certificate_for_tests() } else { Options::default() };
    let robot = text("--robot").map_or_else(made_up, |path| Robot::load(&path));
    let config = config_of(&robot, options);
    let mut state = State::at_rest(&config, robot.home);
    let mut checker = Checker::new(&robot, *state.planned());
    let mut attacker = Attacker::new(&robot, Pcg64::seed_from_u64(seed));
    let mut times = Vec::with_capacity(ticks as usize);
    let (mut candidates, mut evaluations, mut most) = ([0_u64; 4], 0_u64, 0);
    for k in 0..ticks {
        if flag("--smooth") {
            let t = k as f64 / 1500.0;
            attacker.q = std::array::from_fn(|j| robot.home[j] + 0.1 * ((2.0 + 0.1 * j as f64) * t).sin());
            attacker.dq = std::array::from_fn(|j| {
                let w = 2.0 + 0.1 * j as f64;
                0.1 * w * (w * t).cos()
            });
            attacker.speed_scale = Some(1.0);
        } else {
            attacker.next(k, &state.planned().q);
        }
        let input = input(k, &attacker);
        let began = Instant::now();
        let out = tick(&config, &mut state, Stamp::NONE, input);
        times.push(began.elapsed().as_nanos() as u64);
        candidates[match out.candidate {
            Candidate::All => 0,
            Candidate::Left => 1,
            Candidate::Right => 2,
            Candidate::Plan => 3,
        }] += 1;
        evaluations += u64::from(out.evaluations);
        most = most.max(out.evaluations);
        checker.command(k, &out.motion, out.on_plan, k.is_multiple_of(dense));
    }
    times.sort_unstable();
    let at = |share: f64| times[((times.len() - 1) as f64 * share) as usize] as f64 / 1e3;
    println!("{} checked pairs, {ticks} ticks, seed {seed}", config.geometry().pair_count());
    println!("violations {}, min clearance {:.4} mm", checker.violations, checker.clearance_m * 1e3);
    for words in &checker.first {
        println!("  {words}");
    }
    println!("tick us: p50 {:.1} p99 {:.1} p99.99 {:.1} max {:.1}", at(0.5), at(0.99), at(0.9999), at(1.0));
    let share = candidates.map(|n| 100.0 * n as f64 / ticks as f64);
    println!("all {:.1} %, left {:.1} %, right {:.1} %, plan {:.1} %", share[0], share[1], share[2], share[3]);
    println!("kinematics per tick: mean {:.1}, most {most}", evaluations as f64 / ticks as f64);
    std::process::exit(i32::from(checker.violations > 0));
}
