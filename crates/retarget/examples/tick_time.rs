//! Prints what the pieces of a tick cost on this machine: median and 99th percentile over many repetitions.

use std::f64::consts::FRAC_PI_2;
use std::hint::black_box;
use std::time::Instant;

use messages::{JOINTS, Layout, Skeleton, deadline, skeleton_flag};
use nalgebra::Vector3;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use retarget::{
    ArmIdentity, ArmModel, ArmQ, Config, Dense, Input, LATENT, Layers, Limbs, Manifest, Network, Options, PRIOR_WEIGHT,
    RobotArms, State, Weights, features, refine, tick, write_weights, xyzw_from_rotation,
};

fn main() {
    let (z, x, y) = (Vector3::z(), Vector3::x(), Vector3::y());
    let arm = ArmModel::new(
        [-z, -x, y, -z, -y],
        [0.0, 0.0, FRAC_PI_2, 0.0, 0.0],
        [-1.178, -1.178, -0.785, -0.393, -2.094],
        [1.571, 1.571, 3.927, 2.356, 2.094],
    );
    let mut rng = Pcg64::seed_from_u64(1);
    let mut network = |inputs: usize, outputs: usize| {
        let widths = [inputs, 128, 128, 128, 128, 128, 128, outputs];
        widths.windows(2).map(|w| dense(&mut rng, w[0], w[1])).collect::<Vec<_>>()
    };
    let layers = Layers { human: network(12, LATENT), robot: network(5, LATENT), decoder: network(LATENT, 5) };
    let network = Network::new(&layers, &arm);
    let q: [ArmQ; 2] = std::array::from_fn(|_| std::array::from_fn(|j| rng.random_range(arm.q_min[j]..arm.q_max[j])));
    let human: [Limbs; 2] = q.map(|q| arm.forward(&q));
    let input = human.map(|limbs| features(&limbs));
    let latent = network.encode_human(&input);
    let start = network.decode(&latent);
    time("encode, both arms", || network.encode_human(black_box(&input))[0][0] as f64);
    time("encode, one arm", || network.encode_human(black_box(&[input[0]]))[0][0] as f64);
    time("decode, both arms", || network.decode(black_box(&latent))[0][0]);
    time("K = 2, both arms", || {
        (0..2).map(|n| refine(&arm, black_box(&human[n]), &start[n], &start[n], PRIOR_WEIGHT, 2).s_gr).sum()
    });
    time("encode + decode + K = 2, both arms", || {
        let input = black_box(&human).map(|limbs| features(&limbs));
        let start = network.decode(&network.encode_human(&input));
        (0..2).map(|n| refine(&arm, &human[n], &start[n], &start[n], PRIOR_WEIGHT, 2).s_gr).sum()
    });
    whole_ticks(&arm, &layers, &human);
}

/// Whole ticks: a skeleton every fifth of them, as from a source of 300 Hz.
fn whole_ticks(arm: &ArmModel, layers: &Layers, human: &[Limbs; 2]) {
    let joints = std::array::from_fn(|j| format!("joint_{j}"));
    let identity = ArmIdentity { robot: "example".into(), robot_hash: 0, joints, arm: arm.clone() };
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
    time("tick, a new skeleton in every fifth", || {
        k += 1;
        if k % 5 == 0 {
            skeleton.header.sequence += 1;
            skeleton.received = deadline(k);
        }
        tick(&config, &mut state, deadline(k), Input { k, skeleton: Some(&skeleton) }).limb_error_rad[0]
    });
}

fn dense(rng: &mut Pcg64, inputs: usize, outputs: usize) -> Dense {
    let scale = (3.0 / inputs as f32).sqrt();
    Dense {
        inputs,
        outputs,
        weight: (0..inputs * outputs).map(|_| rng.random_range(-scale..scale)).collect(),
        bias: (0..outputs).map(|_| rng.random_range(-0.1..0.1)).collect(),
    }
}

fn time(name: &str, mut run: impl FnMut() -> f64) {
    let mut us: Vec<f64> = (0..20_000)
        .map(|_| {
            let start = Instant::now();
            black_box(run());
            start.elapsed().as_secs_f64() * 1e6
        })
        .collect();
    us.sort_by(f64::total_cmp);
    println!("{name:40} median {:7.2} us   p99 {:7.2} us", us[us.len() / 2], us[us.len() * 99 / 100]);
}
