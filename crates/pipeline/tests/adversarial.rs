//! Whole-body control and the gate together under hostile targets, judged by the simulated robot's own checker.

use messages::{ALL_JOINTS, Header, JOINTS, JointCommand, Layout, Mode, deadline};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use safety::{engage, gate};
use std::path::Path;

/// Ticks in this test; `.ci/long` runs a million.
const TICKS: u64 = 100_000;

struct Outcome {
    violations: u64,
    clearance_violations: u64,
    denials: u64,
    travelled_rad: f64,
}

/// Drives both stages over `ticks` ticks of jumps, limits and noise. Without the certificate the gate is left out too:
/// what is shown then is that the attack is one.
fn attack(ticks: u64, seed: u64, certified: bool) -> Outcome {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/robots/tiago_dual.toml");
    let (model, _) = pipeline::load_model(&file).expect("the shipped robot");
    let options = if certified { wbc::Options::default() } else { wbc::Options::without_certificate_for_tests() };
    let wbc_config = wbc::Config::new(&model, options).expect("whole-body control");
    let gate_config = gate::Config::new(&model).expect("the gate");
    let exact = sim::Options { encoder_noise_rad: 0.0, encoder_step_rad: 0.0, ..sim::Options::default() };
    let sim_config = sim::Config::new(&model, &exact).expect("the simulated robot");
    let first_k = 1500;
    let mut robot = sim::State::new(&sim_config, first_k, seed);
    let start = robot.follower().motion;
    let mut wbc_state = wbc::State::at_rest(&wbc_config, start.q);
    let mut gate_state = gate::State::at_rest(start.q);
    let (mut rng, mut goal, mut travelled_rad, mut last) = (Pcg64Mcg::seed_from_u64(seed), model.home, 0.0, start.q);
    let mut noise = 0.0;
    for k in first_k + 1..=first_k + ticks {
        if rng.random_range(0..400) == 0 {
            noise = [0.0, 0.0, 0.05, 1.0][rng.random_range(0..4)];
            goal = core::array::from_fn(|j| {
                let limits = &model.limits[j];
                // One in five joints is sent to a limit or far beyond it.
                match rng.random_range(0..10) {
                    0 => limits.q_min - 1.0,
                    1 => limits.q_max + 1.0,
                    _ => rng.random_range(limits.q_min..limits.q_max),
                }
            });
        }
        let q: [f64; JOINTS] = goal.map(|q| q + noise * rng.random_range(-1.0..1.0));
        let now = deadline(k);
        let target = wbc::Target { q: &q, dq: &[0.0; JOINTS], valid_mask: ALL_JOINTS };
        let permit = wbc::Permit::Follow { speed_scale: 1.0 };
        let proposed = wbc::tick(&wbc_config, &mut wbc_state, now, wbc::Input { k, target: Some(target), permit });
        let mut command = JointCommand {
            header: Header { sequence: k, stamp: now, incarnation: 1, ..Header::ZERO },
            k,
            seed_k: first_k,
            q: proposed.q,
            v: proposed.v,
            a: proposed.a,
            plan: proposed.plan,
            mode: Mode::Engaged as u32,
            ..JointCommand::ZERO
        };
        if certified {
            let permit = engage::Permit::Follow { speed_scale: 1.0 };
            let offer = gate::Proposed { k, permit, q: command.q, v: command.v, a: command.a, plan: command.plan };
            let decision = gate::tick(&gate_config, &mut gate_state, now, offer);
            (command.q, command.v, command.a, command.plan) = (decision.q, decision.v, decision.a, decision.plan);
            if !decision.accepted() {
                let (q, v, a, plan) = (decision.q, decision.v, decision.a, decision.plan);
                wbc_state.reseed(&wbc::Planned { q, v, a, plan });
            }
        }
        let out = sim::tick(&sim_config, &mut robot, now, sim::Input { due_k: k, command: Some(&command) });
        assert!(out.accepted.is_some(), "seed {seed}, tick {k}: the driver refused: {:?}", out.refused);
        travelled_rad += (0..JOINTS).map(|j| (command.q[j] - last[j]).abs()).sum::<f64>();
        last = command.q;
    }
    Outcome {
        violations: robot.report().violations_total(),
        clearance_violations: robot.report().violations_of(sim::ViolationKind::Clearance),
        denials: gate_state.denials(),
        travelled_rad,
    }
}

#[test]
fn hostile_targets_break_nothing() {
    let outcome = attack(TICKS, 7, true);
    println!("{} denials, {:.0} rad travelled", outcome.denials, outcome.travelled_rad);
    assert_eq!(outcome.violations, 0);
    assert!(outcome.travelled_rad > 100.0, "the attack hardly moved the robot: {} rad", outcome.travelled_rad);
}

#[test]
fn without_the_certificate_the_same_attack_collides() {
    assert!(attack(TICKS / 10, 7, false).clearance_violations > 0);
}

#[test]
#[ignore = "a million ticks: cargo test --release -p pipeline --test adversarial -- --ignored"]
fn a_million_hostile_targets_break_nothing() {
    let outcome = attack(1_000_000, 8, true);
    println!("{} denials, {:.0} rad travelled", outcome.denials, outcome.travelled_rad);
    assert_eq!(outcome.violations, 0);
}
