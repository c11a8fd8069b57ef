//! The retarget tick of the shipped robot and weights, and its parts, for both arms. Criterion keeps the figures
//! under `target/criterion` and compares the next run with them.

use criterion::{Criterion, criterion_group, criterion_main};
use messages::{Layout, Skeleton, deadline, skeleton_flag};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use retarget::{
    ArmModel, ArmQ, Config, Input, Limbs, Manifest, Network, PRIOR_WEIGHT, Settings, State, Weights, features,
    read_layers, refine, solve_poses, tick, xyzw_from_rotation,
};
use robot::Model;
use std::hint::black_box;

/// Levenberg-Marquardt steps of the shipped settings.
const REFINE_STEPS: u32 = 2;

/// The shipped robot, its weights, and limbs that it can reach.
struct Shipped {
    model: Model,
    arm: ArmModel,
    manifest: String,
    tensors: Vec<u8>,
    limbs: [Limbs; 2],
}

fn shipped() -> Shipped {
    let path = |file: &str| format!("{}/../../{file}", env!("CARGO_MANIFEST_DIR"));
    let text = |file: &str| std::fs::read_to_string(path(file)).unwrap_or_else(|error| panic!("{file}: {error}"));
    let [toml, urdf] = ["config/robots/tiago_dual.toml", "config/robots/tiago_dual.urdf"].map(text);
    let model = Model::from_text("tiago_dual.toml", &toml, "tiago_dual.urdf", &urdf).expect("the shipped robot");
    let arm = ArmModel::from_model(&model);
    let mut rng = Pcg64::seed_from_u64(1);
    let q: [ArmQ; 2] = std::array::from_fn(|_| std::array::from_fn(|j| rng.random_range(arm.q_min[j]..arm.q_max[j])));
    let limbs = q.map(|q| arm.forward(&q));
    let tensors = std::fs::read(path("weights/tiago_dual.safetensors")).expect("the shipped weights");
    Shipped { model, arm, manifest: text("weights/tiago_dual.toml"), tensors, limbs }
}

/// Measures whole ticks with a new skeleton in each, and in one of five.
fn ticks(criterion: &mut Criterion) {
    let Shipped { model, manifest, tensors, limbs, .. } = shipped();
    let weights = Weights::from_bytes(&manifest, &tensors, &model).expect("weights of the shipped robot");
    let settings = Settings { refinement_steps: REFINE_STEPS, ..Settings::default() };
    let config = Config::new(&model, Some(weights), &settings).expect("settings are in range");
    let mut skeleton = Skeleton { flags: skeleton_flag::ALL, ..Skeleton::ZERO };
    for (n, arm) in limbs.iter().enumerate() {
        let limbs = [arm.upper, arm.fore].map(|limb| xyzw_from_rotation(&limb).map(|x| x as f32));
        skeleton.limbs[2 * n..2 * n + 2].copy_from_slice(&limbs);
    }
    for (name, every) in [("retarget tick", 1), ("retarget tick, a new skeleton in every fifth", 5)] {
        let (mut state, mut k) = (State::default(), 1500);
        criterion.bench_function(name, |bencher| {
            bencher.iter(|| {
                k += 1;
                if k % every == 0 {
                    skeleton.header.sequence += 1;
                    skeleton.received = deadline(k);
                }
                tick(&config, &mut state, deadline(k), Input { k, skeleton: Some(&skeleton) })
            });
        });
    }
}

/// Measures the parts of a tick.
fn parts(criterion: &mut Criterion) {
    let Shipped { arm, manifest, tensors, limbs, .. } = shipped();
    let manifest: Manifest = toml::from_str(&manifest).expect("a manifest");
    let layers = read_layers(&tensors, &manifest).expect("layers");
    let network = Network::new(&layers, &arm);
    criterion.bench_function("encode, decode, refine", |bencher| {
        bencher.iter(|| solve_poses(&arm, &network, black_box(&limbs), REFINE_STEPS));
    });
    criterion.bench_function("encode, decode", |bencher| {
        bencher.iter(|| network.decode(&network.encode_human(&black_box(&limbs).each_ref().map(features))));
    });
    let start = network.decode(&network.encode_human(&limbs.each_ref().map(features)));
    criterion.bench_function("refine", |bencher| {
        bencher.iter(|| [0, 1].map(|n| refine(&arm, &limbs[n], &start[n], &start[n], PRIOR_WEIGHT, REFINE_STEPS)));
    });
}

criterion_group!(benches, ticks, parts);
criterion_main!(benches);
