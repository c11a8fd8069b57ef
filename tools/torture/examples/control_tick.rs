//! Times the control tick, which is whole-body control and the gate: `control_tick [--ticks N] [--seed S] [--robot NAME]
//! [--only KIND]`.
//! Prints JSON with the percentiles in us, and a digest of every decision. `tools/torture/bench_placo.py` runs it in
//! turns with placo.
//!
//! - *smooth*: sines about the home posture, far from collisions. Most of a session is like this.
//! - *jumps*: a random posture every second, most of them in collision.
//! - *attack*: the attacks of `torture`.

use config::RobotChoice;
use control::Commanded;
use judge::Attacker;
use messages::{ALL_JOINTS, JOINTS_MAX, TICK_HZ, TICK_S, deadline};
use rand::SeedableRng;
use rand_pcg::Pcg64;
use robot::Model;
use safety::engage::Permit;
use std::path::Path;
use torture::cli::Changes;
use torture::stages::{Stages, Subject, permit, target};

/// Amplitude of the smooth motion, rad. The lift moves a hundredth of it, m.
const WAVE_RAD: f64 = 0.2;
/// Ticks between two random postures.
const JUMP_EVERY: u64 = TICK_HZ;
/// Ticks that are not counted, because caches and branch predictors warm up.
const WARM: u64 = 2000;

type Positions = [f64; JOINTS_MAX];

/// Durations of the ticks, ns, and an FNV-1a digest of the decisions.
struct Measured {
    durations: Vec<u64>,
    digest: u64,
}

impl Measured {
    fn add(&mut self, k: u64, (out, ns): (Commanded, u64)) {
        if k > WARM {
            self.durations.push(ns);
        }
        let motion = &out.motion;
        let plan = motion.plan.jerk.iter().chain(&motion.plan.duration_s).flatten();
        let numbers = motion.q.iter().chain(&motion.v).chain(&motion.a).chain(plan).map(|x| x.to_bits());
        let proposed = &out.proposed;
        let decided = [u64::from(out.denied.is_some()), u64::from(proposed.on_plan), proposed.clearance_m.to_bits()];
        for word in numbers.chain(decided) {
            self.digest = (self.digest ^ word).wrapping_mul(0x0000_0100_0000_01b3);
        }
    }

    fn json(mut self) -> String {
        self.durations.sort_unstable();
        let last = self.durations.len() - 1;
        let at = |share: f64| self.durations[(last as f64 * share) as usize] as f64 * 1e-3;
        let [p50, p99, p99_9] = [0.5, 0.99, 0.999].map(at);
        let mean = self.durations.iter().sum::<u64>() as f64 * 1e-3 / (last + 1) as f64;
        let times = format!(r#""p50": {p50:.2}, "mean": {mean:.2}, "p99": {p99:.2}, "p99_9": {p99_9:.2}"#);
        format!(r#"{{ {times}, "digest": "{:016x}" }}"#, self.digest)
    }
}

/// q = home + s sin(w t) and its derivative, with w = 1 + j / 10 rad/s. This is slow enough for the lift.
fn wave(model: &Model, t: f64) -> (Positions, Positions) {
    let w = |j: usize| 1.0 + 0.1 * j as f64;
    let size = |j: usize| match j {
        _ if j >= model.count => 0.0,
        _ if model.prismatic[j] => 0.01 * WAVE_RAD,
        _ => WAVE_RAD,
    };
    let q = std::array::from_fn(|j| model.home[j] + size(j) * (w(j) * t).sin());
    (q, std::array::from_fn(|j| size(j) * w(j) * (w(j) * t).cos()))
}

fn follow(subject: &Subject, ticks: u64, mut aim: impl FnMut(u64) -> (Positions, Positions)) -> String {
    let mut stages = Stages::at_rest(subject, subject.model.home);
    let mut measured = Measured { durations: Vec::with_capacity(ticks as usize), digest: 0 };
    for k in 1..=ticks + WARM {
        let (q, dq) = aim(k);
        let target = wbc::Target { q: &q, dq: &dq, ddq: &[0.0; JOINTS_MAX], valid_mask: ALL_JOINTS };
        measured.add(k, stages.tick(k, deadline(k), Some(target), Permit::Follow { speed_scale: 1.0 }));
    }
    measured.json()
}

fn attack(subject: &Subject, ticks: u64, seed: u64) -> String {
    let mut stages = Stages::at_rest(subject, subject.model.home);
    let mut attacker = Attacker::new(&subject.robot, Pcg64::seed_from_u64(seed));
    let mut measured = Measured { durations: Vec::with_capacity(ticks as usize), digest: 0 };
    let mut last = subject.model.home;
    for k in 1..=ticks + WARM {
        attacker.next(k, &last);
        let (out, ns) = stages.tick(k, deadline(k), target(&attacker), permit(&attacker));
        last = out.motion.q;
        measured.add(k, (out, ns));
    }
    measured.json()
}

fn text(name: &str) -> Option<String> {
    let mut arguments = std::env::args();
    arguments.find(|argument| argument == name).and_then(|_| arguments.next())
}

fn number(name: &str, default: u64) -> u64 {
    text(name).map_or(default, |text| text.parse().unwrap_or_else(|_| panic!("{name} {text}: not a number")))
}

/// Returns true if a kind of motion is to be measured: all of them, or that of `--only KIND`.
fn is_measured(kind: &str) -> bool {
    text("--only").is_none_or(|only| only == kind)
}

fn main() {
    // The daemon does the same, before any other thread starts.
    let _ = rt::flush_denormals();
    let (ticks, seed) = (number("--ticks", 100_000).max(TICK_HZ), number("--seed", 1));
    let settings = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/teleop.toml");
    let robot = text("--robot").map(|name| RobotChoice::from(name.as_str()));
    let subject = Subject::load(&settings, robot.as_ref(), Changes::default());
    let subject = subject.unwrap_or_else(|failure| panic!("{failure:?}"));
    let model = &subject.model;
    let mut rows = vec![format!(r#""pairs": {}, "ticks": {ticks}"#, model.pairs.len())];
    if is_measured("smooth") {
        let smooth = follow(&subject, ticks, |k| wave(model, k as f64 * TICK_S));
        rows.push(format!(r#""smooth_us": {smooth}"#));
    }
    if is_measured("jumps") {
        let (mut rng, mut goal) = (Pcg64::seed_from_u64(seed), model.home);
        let jumps = follow(&subject, ticks, |k| {
            if k.is_multiple_of(JUMP_EVERY) {
                goal = subject.robot.posture(&mut rng);
            }
            (goal, [0.0; JOINTS_MAX])
        });
        rows.push(format!(r#""jumps_us": {jumps}"#));
    }
    if is_measured("attack") {
        rows.push(format!(r#""attack_us": {}"#, attack(&subject, ticks, seed)));
    }
    println!("{{ {} }}", rows.join(", "));
}
