//! The ticks of the shipped robot and settings, the parts of the retarget tick, and the lifter of a camera's image. The
//! control tick follows the built-in motion. Criterion keeps the figures and compares the next run with them.

use client::PlayOptions;
use config::{Loaded, Overrides};
use control::{Config, Input, State};
use criterion::{Criterion, criterion_group, criterion_main};
use layouts::{ImagePoints, POINTS};
use messages::{JointTarget, Layout, Mode, RobotState, Skeleton, Stamp, deadline, skeleton_flag};
use motion::CalibrationMode;
use rand::{RngExt, SeedableRng};
use retarget::{ArmModel, ArmQ, Limbs, PRIOR_WEIGHT, features, refine, solve_poses, xyzw_from_rotation};
use safety::engage::OperatorView;
use std::hint::black_box;
use std::path::Path;
use world::{Offline, OfflineEnd};

/// The inputs of one control tick.
struct Received {
    k: u64,
    now: Stamp,
    target: Option<JointTarget>,
    robot: Option<RobotState>,
    operator: OperatorView,
}

impl Received {
    fn tick(&self, config: &Config, state: &mut State) -> Mode {
        let (target, robot) = (self.target.as_ref(), self.robot.as_ref());
        let input =
            Input { k: self.k, target, policy: None, robot, operator: self.operator, ingest: None, realtime_ok: true };
        let mode = control::tick(config, state, self.now, input).status.mode;
        Mode::from_u32(mode).expect("a mode")
    }
}

fn shipped() -> Loaded {
    let settings = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/teleop.toml");
    config::load(&settings, Overrides::default()).expect("the shipped settings")
}

/// Returns limbs that both arms can reach.
fn limbs(arm: &ArmModel) -> [Limbs; 2] {
    let mut rng = rand_pcg::Pcg64::seed_from_u64(1);
    let q: [ArmQ; 2] = std::array::from_fn(|_| std::array::from_fn(|j| rng.random_range(arm.q_min[j]..arm.q_max[j])));
    q.map(|q| arm.forward(&q))
}

/// Measures whole ticks with a new skeleton in each, and in one of five.
fn retarget_ticks(criterion: &mut Criterion) {
    let loaded = shipped();
    let config = world::retarget_config(&loaded).expect("settings are in range");
    let mut skeleton = Skeleton { flags: skeleton_flag::ALL, ..Skeleton::ZERO };
    for (n, arm) in limbs(&ArmModel::from_model(&loaded.model, 0)).iter().enumerate() {
        let limbs = [arm.upper, arm.fore].map(|limb| xyzw_from_rotation(&limb).map(|x| x as f32));
        skeleton.limbs[2 * n..2 * n + 2].copy_from_slice(&limbs);
    }
    for (name, every) in [("retarget tick", 1), ("retarget tick, a new skeleton in every fifth", 5)] {
        let (mut state, mut k) = (retarget::State::default(), 1500);
        criterion.bench_function(name, |bencher| {
            bencher.iter(|| {
                k += 1;
                if k % every == 0 {
                    skeleton.header.sequence += 1;
                    skeleton.received = deadline(k);
                }
                retarget::tick(&config, &mut state, deadline(k), retarget::Input { k, skeleton: Some(&skeleton) })
            });
        });
    }
}

/// Measures the parts of a retarget tick.
fn retarget_parts(criterion: &mut Criterion) {
    let loaded = shipped();
    let (arm, steps) = (ArmModel::from_model(&loaded.model, 0), loaded.settings.retarget.refinement_steps);
    let (limbs, network) = (limbs(&arm), loaded.weights.expect("the shipped weights").network);
    criterion.bench_function("encode, decode, refine", |bencher| {
        bencher.iter(|| solve_poses([&arm; 2], &network, black_box(&limbs), steps));
    });
    criterion.bench_function("encode, decode", |bencher| {
        bencher.iter(|| network.decode(&network.encode_human(&black_box(&limbs).each_ref().map(features))));
    });
    let start = network.decode(&network.encode_human(&limbs.each_ref().map(features)));
    criterion.bench_function("refine", |bencher| {
        bencher.iter(|| [0, 1].map(|n| refine(&arm, &limbs[n], &start[n], &start[n], PRIOR_WEIGHT, steps)));
    });
}

fn control_ticks(criterion: &mut Criterion) {
    let loaded = shipped();
    let options = PlayOptions { speed: 1.0, looped: false, calibration: CalibrationMode::First10s };
    let (mut received, mut engaged, mut incarnation) = (Vec::new(), Vec::new(), 0);
    let end = Offline::new(&loaded, &motion::builtin(), options).expect("a run").play(|tick| {
        let Some(control) = &tick.moment.control else { return };
        let (status, operator) = (&control.status, *tick.operator);
        let (target, robot) = (tick.moment.target_seen, tick.moment.state_seen);
        received.push(Received { k: status.k, now: status.header.stamp, target, robot, operator });
        engaged.push(status.mode == Mode::Engaged as u32);
        incarnation = status.header.incarnation;
    });
    assert_eq!(end, OfflineEnd::AtRest);
    let begins = engaged.iter().position(|engaged| *engaged).expect("it engages");
    let ends = engaged.iter().rposition(|engaged| *engaged).expect("it engages");

    let config = world::control_config(&loaded, true).expect("control");
    let mut begun = State::new(&config, incarnation);
    received[..begins].iter().for_each(|received| _ = received.tick(&config, &mut begun));
    let (mut state, mut next) = (begun.clone(), begins);
    criterion.bench_function("control tick", |bencher| {
        bencher.iter(|| {
            if next > ends {
                (state, next) = (begun.clone(), begins);
            }
            let mode = received[next].tick(&config, &mut state);
            assert_eq!(mode, Mode::Engaged);
            next += 1;
        });
    });
}

fn lift(criterion: &mut Criterion) {
    let lifter = shipped().lifter.expect("the shipped lifter");
    // The time is the same for every image with a trunk.
    let points = std::array::from_fn(|i| [0.1 * (i as f32).sin(), 0.1 * (i as f32).cos()]);
    let image = ImagePoints { points, seen: [1.0; POINTS] };
    criterion.bench_function("lift", |bencher| {
        bencher.iter(|| lifter.lift(black_box(&image), None).expect("a trunk"));
    });
}

criterion_group!(benches, retarget_ticks, retarget_parts, control_ticks, lift);
criterion_main!(benches);
