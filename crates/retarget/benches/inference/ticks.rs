//! The whole tick: encode, decode and refine both arms.

use std::f64::consts::FRAC_PI_2;

use messages::{JOINTS, Layout, Skeleton, deadline, skeleton_flag};
use nalgebra::Vector3;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use retarget::{
    ArmIdentity, ArmModel, ArmQ, Config, Input, LATENT, Layers, Level, Limbs, Manifest, Network, Options, PRIOR_WEIGHT,
    Precision, RobotArms, State, Weights, features, refine, tick, write_weights, xyzw_from_rotation,
};

use crate::contest::{Contest, Entry};
use crate::network;

/// Prints the cost of ticks and of their parts.
pub(crate) fn measure() {
    let (z, x, y) = (Vector3::z(), Vector3::x(), Vector3::y());
    let arm = ArmModel::new(
        [-z, -x, y, -z, -y],
        [0.0, 0.0, FRAC_PI_2, 0.0, 0.0],
        [-1.178, -1.178, -0.785, -0.393, -2.094],
        [1.571, 1.571, 3.927, 2.356, 2.094],
    );
    let mut rng = Pcg64::seed_from_u64(1);
    let layers = Layers {
        human: network(&mut rng, 12, LATENT),
        robot: network(&mut rng, 5, LATENT),
        decoder: network(&mut rng, LATENT, 5),
    };
    let q: [ArmQ; 2] = std::array::from_fn(|_| std::array::from_fn(|j| rng.random_range(arm.q_min[j]..arm.q_max[j])));
    let human: [Limbs; 2] = q.map(|q| arm.forward(&q));
    let mut contest = Contest::new("both arms");
    for every in [1, 5] {
        let name = if every == 1 { "tick with a new skeleton" } else { "tick, a new skeleton in every fifth" };
        contest.add(Entry::reading(name.into(), ticks(&arm, &layers, &human, every)));
    }
    for (name, precision) in [("f32", Precision::F32), ("bf16", Precision::Bf16)] {
        let network = Network::at_level(&layers, &arm, precision, Level::best());
        contest.add(Entry::reading(format!("encode + decode + K = 2, {name}"), solve(&arm, network, &human, 2)));
    }
    let network = Network::new(&layers, &arm);
    contest.add(Entry::reading("encode + decode, f32".into(), solve(&arm, network.clone(), &human, 0)));
    let start = human.map(|limbs| network.decode(&network.encode_human(&[features(&limbs)]))[0]);
    contest.add(Entry::reading("K = 2".into(), {
        let arm = arm.clone();
        move || (0..2).map(|n| refine(&arm, &human[n], &start[n], &start[n], PRIOR_WEIGHT, 2).s_gr as f32).sum()
    }));
    contest.run("12 us is what SEW-Mimic's closed form in C++ takes for two arms");
}

/// Computes refined postures from limbs.
fn solve(arm: &ArmModel, network: Network, human: &[Limbs; 2], steps: u32) -> impl FnMut() -> f32 + use<> {
    let (arm, human) = (arm.clone(), *human);
    move || {
        let input = human.map(|limbs| features(&limbs));
        let start = network.decode(&network.encode_human(&input));
        if steps == 0 {
            return start[0][0] as f32;
        }
        (0..2).map(|n| refine(&arm, &human[n], &start[n], &start[n], PRIOR_WEIGHT, steps).s_gr as f32).sum()
    }
}

/// Runs whole ticks with a new skeleton in one out of `every`.
fn ticks(arm: &ArmModel, layers: &Layers, human: &[Limbs; 2], every: u64) -> impl FnMut() -> f32 + use<> {
    let joints = std::array::from_fn(|j| format!("joint_{j}"));
    let identity = ArmIdentity { robot: "benchmark".into(), robot_hash: 0, joints, arm: arm.clone() };
    let (bytes, manifest) = write_weights(layers, &Manifest::new(&identity, layers)).expect("weights are written");
    let weights = Weights::read(&manifest, &bytes, &identity).expect("weights are read");
    let robot = RobotArms { identity, velocity_max: [2.0; 5], home: [0.0; JOINTS] };
    let config = Config::for_arms(&robot, Some(weights), &Options::default()).expect("options are in range");
    let mut skeleton = Skeleton { flags: skeleton_flag::ALL, ..Skeleton::ZERO };
    for (n, arm) in human.iter().enumerate() {
        let limbs = [arm.upper, arm.fore].map(|limb| xyzw_from_rotation(&limb).map(|x| x as f32));
        skeleton.limbs[2 * n..2 * n + 2].copy_from_slice(&limbs);
    }
    let (mut state, mut k) = (State::default(), 1500);
    move || {
        k += 1;
        if k % every == 0 {
            skeleton.header.sequence += 1;
            skeleton.received = deadline(k);
        }
        tick(&config, &mut state, deadline(k), Input { k, skeleton: Some(&skeleton) }).limb_error_rad[0] as f32
    }
}
