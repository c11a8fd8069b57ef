//! Every stage in one thread with virtual time: deterministic from a printed seed, and safe whatever the links do.

use bus::FaultPlan;
use messages::{JOINTS, Mode, TICK_HZ, TICK_S};
use motion::CalibrationMode;
use pipeline::{Links, Moment, Overrides, PlayOptions, Player, Running, World, WorldConfig};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use safety::engage::OperatorView;
use std::path::Path;

/// Length of a run: engaging takes 3 to 5 s, the rest is motion under faults.
const TICKS: u64 = 18 * TICK_HZ;

/// From here on, faults: processes stop, and the operator lets go, resets and enables again every 4 s.
const FAULTS_FROM: u64 = 6 * TICK_HZ;

fn world_config() -> WorldConfig {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("config/teleop.toml");
    let loaded = pipeline::load(&path, Overrides::default()).expect("the settings of the repository");
    WorldConfig::new(&loaded).expect("a world")
}

fn bad_link(rng: &mut Pcg64Mcg, badness: f64) -> FaultPlan {
    FaultPlan {
        drop: badness * rng.random_range(0.0..0.2),
        duplicate: badness * rng.random_range(0.0..0.1),
        reorder: badness * rng.random_range(0.0..0.05),
        reorder_ns: 2_000_000,
        delay_min_ns: 0,
        delay_max_ns: (badness * rng.random_range(0.0..1_000_000.0)) as u64,
    }
}

/// What a run leaves: a hash over every executed state, and the modes it went through.
#[derive(Debug, PartialEq)]
struct Outcome {
    hash: u64,
    modes: Vec<u32>,
    engaged_ticks: u64,
}

/// A run in which links are as bad as `badness` (0: perfect) and processes stop for a while at random.
fn run(config: &WorldConfig, seed: u64, badness: f64) -> Outcome {
    let mut rng = Pcg64Mcg::seed_from_u64(seed);
    let mut links = || bad_link(&mut rng, badness);
    let links = Links { raw: links(), skeleton: links(), target: links(), command: links(), state: links() };
    let mut world = World::new(config, seed, links);
    let play = PlayOptions { speed: 1.0, looped: true, calibration: CalibrationMode::First10s };
    let mut player = Player::new(&motion::builtin(), play, seed | 1, 1);
    let mut oracle = Oracle::new(config);
    let (mut mode, mut modes, mut engaged_ticks) = (Mode::Disengaged, vec![], 0);
    let (mut stopped, mut next_fault) = ((Running::ALL, 0), 0);
    for k in 0..TICKS {
        if badness > 0.0 && k > FAULTS_FROM && k >= next_fault {
            let who = rng.random_range(0..6);
            let running = Running { ingest: who != 0, retarget: who != 1, control: who != 2, driver: who != 3 };
            stopped = (running, k + rng.random_range(1..60));
            next_fault = k + rng.random_range(200..3000);
            if who == 4 {
                world.restart_control(config);
            }
            if who == 5 {
                world.restart_retarget();
            }
        }
        let now = world.now();
        if let Some((_, raw)) = player.due(now, mode == Mode::Engaged) {
            world.publish(&raw);
        }
        // The hand of an operator who lets go for 0.7 s, presses reset once the robot rests, and enables again.
        let beat = (k > FAULTS_FROM && badness > 0.0).then_some(k % (4 * TICK_HZ));
        let operator = OperatorView {
            connected: true,
            enable_level: k > TICK_HZ && beat.is_none_or(|beat| beat >= 1000),
            enable_edge: k == TICK_HZ + 1 || beat == Some(1000),
            release_edge: beat == Some(0),
            reset_edge: beat == Some(900),
            heartbeat_received: now,
            ..OperatorView::default()
        };
        let running = if k < stopped.1 { stopped.0 } else { Running::ALL };
        let moment = world.step(config, &operator, running);
        oracle.check(seed, &moment);
        if let Some(control) = &moment.control {
            mode = Mode::from_u32(control.status.mode).expect("a mode");
            if modes.last() != Some(&control.status.mode) {
                modes.push(control.status.mode);
            }
            engaged_ticks += u64::from(mode == Mode::Engaged && k > FAULTS_FROM);
        }
    }
    for (kind, count) in world.report().violations() {
        assert_eq!(count, 0, "seed {seed}: {kind} violations");
    }
    Outcome { hash: oracle.hash, modes, engaged_ticks }
}

/// Sees only what the robot executes, and judges it by differences alone.
struct Oracle {
    limits: [robot::JointLimits; JOINTS],
    last: Option<(u64, [f64; JOINTS])>,
    hash: u64,
}

impl Oracle {
    fn new(config: &WorldConfig) -> Self {
        Self { limits: config.control.model.limits, last: None, hash: 0xcbf2_9ce4_8422_2325 }
    }

    fn check(&mut self, seed: u64, moment: &Moment) {
        let Some(robot) = &moment.robot else { return };
        let index = robot.executed_k + robot.plan_ticks_played;
        if let Some((last_index, last)) = self.last {
            assert!(index >= last_index, "seed {seed}, tick {}: time went back", moment.k);
            let dt = (index - last_index) as f64 * TICK_S;
            for (j, limits) in self.limits.iter().enumerate() {
                let q = robot.q[j];
                assert!(
                    q >= limits.q_min - 1e-9 && q <= limits.q_max + 1e-9,
                    "seed {seed}, tick {}: joint {j} at {q}",
                    moment.k
                );
                let moved = (q - last[j]).abs();
                assert!(
                    moved <= limits.v_max * dt + 1e-9,
                    "seed {seed}, tick {}: joint {j} moved {moved} in {dt} s",
                    moment.k
                );
            }
        }
        self.last = Some((index, robot.q));
        for q in robot.q {
            self.hash = (self.hash ^ q.to_bits()).wrapping_mul(0x0000_0100_0000_01b3);
        }
    }
}

#[test]
fn perfect_links_engage_and_stay_engaged() {
    let outcome = run(&world_config(), 1, 0.0);
    assert_eq!(outcome.modes, [Mode::Disengaged as u32, Mode::Engaging as u32, Mode::Engaged as u32]);
    assert!(outcome.engaged_ticks > 11 * TICK_HZ, "{outcome:?}");
}

#[test]
fn two_runs_of_a_seed_are_bit_identical() {
    let config = world_config();
    for seed in [2, 3] {
        println!("seed {seed}");
        let (first, second) = (run(&config, seed, 0.3), run(&config, seed, 0.3));
        assert_eq!(first, second, "seed {seed}");
    }
    assert_ne!(run(&config, 2, 0.3).hash, run(&config, 3, 0.3).hash, "the seed decides");
}

#[test]
fn nothing_that_links_and_processes_do_breaks_a_limit() {
    let config = world_config();
    // Ticks engaged under faults, for mild and for bad links; and runs that moved again after a latched stop. (Whether they
    // align again before the next fault depends on how fast the robot is.)
    let (mut engaged, mut recovered) = ([0, 0], 0);
    for seed in 100..120 {
        let bad = (seed % 2) as usize;
        println!("seed {seed}, badness {}", [0.2, 1.0][bad]);
        let outcome = run(&config, seed, [0.2, 1.0][bad]);
        engaged[bad] += outcome.engaged_ticks;
        let faulted = outcome.modes.iter().position(|mode| *mode == Mode::Faulted as u32);
        recovered += usize::from(faulted.is_some_and(|at| outcome.modes[at..].contains(&(Mode::Engaging as u32))));
    }
    println!("engaged under faults {engaged:?} ticks, {recovered} runs recovered from a latched stop");
    assert!(engaged.iter().all(|ticks| *ticks > TICK_HZ), "the robot hardly ever moved: {engaged:?}");
    assert!(recovered > 0, "no run recovered from a latched stop");
}
