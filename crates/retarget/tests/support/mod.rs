//! An arm like TIAGo's, a network of random weights, and skeletons made from postures.
#![allow(dead_code, reason = "every test file uses a part of it")]

use std::f64::consts::FRAC_PI_2;
use std::path::Path;

use messages::{JOINTS_MAX, Layout, RobotId, Skeleton, Stamp, deadline, skeleton_flag, tick_at};
use nalgebra::Vector3;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use retarget::contact::{Part, Proportions};
use retarget::surface::Surface;
use retarget::{
    ArmIdentity, ArmModel, ArmQ, Config, Dense, Input, KinematicChain, LATENT, Layers, Limbs, Manifest, Method, Output,
    Prediction, RobotArms, Settings, State, Weights, mirror, tick, write_weights, xyzw_from_rotation,
};

/// Time at which the tests begin, ns.
pub(crate) const START_NS: u64 = 5_000_000_000;
/// A millisecond, ns.
pub(crate) const MS: u64 = 1_000_000;
/// The robots with weights of their own.
pub(crate) const ROBOTS: [&str; 6] =
    ["tiago_dual", "unitree_g1", "openarm_v10", "franka_fr3_duo", "rby1a", "unitree_h1"];

/// A shipped robot.
pub(crate) fn shipped(name: &str) -> robot::Model {
    edited(name, |text| text)
}

/// A shipped robot with a changed file.
pub(crate) fn edited(name: &str, edit: impl Fn(String) -> String) -> robot::Model {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/robots");
    let read = |end: &str| std::fs::read_to_string(folder.join(format!("{name}.{end}"))).expect("a robot's file");
    robot::Model::from_text(name, &edit(read("toml")), name, &read("urdf")).expect("the robot")
}

/// The weights of a shipped robot.
pub(crate) fn shipped_weights(model: &robot::Model) -> Weights {
    let base = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../weights").join(&model.name);
    let read = |end: &str| std::fs::read(base.with_extension(end)).expect("weights");
    let manifest = String::from_utf8(read("toml")).expect("text");
    Weights::from_bytes(&manifest, &read("safetensors"), model, 0).expect("they fit the robot")
}

/// Settings of the arm with random weights.
pub(crate) fn config(method: Method, delay_ms: f64) -> Config {
    let settings = Settings { method, following_delay_ms: delay_ms, ..Settings::default() };
    Config::for_arms(&robot(), Some(weights(&layers(1, 2, 32))), &settings).expect("a configuration")
}

/// Axes and reference of a TiaGo++, limits of the robot's URDF.
pub(crate) fn arm() -> ArmModel {
    let (x, y, z) = (Vector3::x(), Vector3::y(), Vector3::z());
    ArmModel::new(
        [-z, -x, y, -z, -y],
        [0.0, 0.0, FRAC_PI_2, 0.0, 0.0],
        [-1.178, -1.178, -0.785, -0.393, -2.094],
        [1.571, 1.571, 3.927, 2.356, 2.094],
    )
}

pub(crate) fn identity() -> ArmIdentity {
    let joints = std::array::from_fn(|j| format!("arm_left_{}_joint", j + 1));
    ArmIdentity { robot: "test".into(), robot_hash: 0xfeed_0000_0000_0001, joints, arm: arm() }
}

pub(crate) fn robot() -> RobotArms {
    RobotArms {
        arms: [arm(), arm()],
        velocity_max: [[1.95, 1.95, 2.35, 2.35, 1.95]; 2],
        home: [0.25; JOINTS_MAX],
        robot: RobotId { hash: 7, joint_count: 17, reserved: 0 },
        joints: [3, 10].map(|first| std::array::from_fn(|j| Some(first + j))),
        signs: [[1.0; 5]; 2],
        wrists: [8, 15].map(wrist),
        head: None,
        lift: None,
        proportions: [Proportions {
            // TIAGo++'s: the arm is straight along y.
            chain: KinematicChain {
                joints: [-0.125, 0.0, 0.09, 0.311, 0.311].map(|along| Vector3::new(0.0, 0.28 + along, 0.0)),
                hand: Vector3::new(0.0, 0.9, 0.0),
            },
            wrist: wrist(8),
            wrist_at: Vector3::new(0.0, 0.75, 0.0),
            head: Some(Part { center: Vector3::new(0.1, 0.0, 0.3), surface: ball(0.15) }),
            reach_m: 0.62,
            hand: ball(0.1),
            forearm: ball(0.07),
            torso_m: [0.1, 0.15],
            chest_m: 0.15,
        }; 2],
    }
}

fn ball(radius_m: f64) -> Surface {
    Surface::new(std::iter::once(([Vector3::zeros(); 2], radius_m)))
}

fn wrist(first: usize) -> robot::PointingJoints {
    robot::PointingJoints {
        joints: [Some(first), Some(first + 1), None],
        axes: [-Vector3::z(), -Vector3::y(), Vector3::zeros()],
        home: [0.25, 0.25, 0.0],
        q_min: [-1.4, -2.0, 0.0],
        q_max: [1.4, 2.0, 0.0],
    }
}

pub(crate) fn random_q(rng: &mut Pcg64, arm: &ArmModel) -> ArmQ {
    std::array::from_fn(|j| rng.random_range(arm.q_min[j]..arm.q_max[j]))
}

pub(crate) fn random_limbs(rng: &mut Pcg64) -> Limbs {
    let mut rotation = || {
        let parts: [f64; 4] = std::array::from_fn(|_| rng.random_range(-1.0..1.0));
        nalgebra::UnitQuaternion::new_normalize(nalgebra::Quaternion::from(parts))
    };
    Limbs { upper: rotation(), fore: rotation() }
}

/// Weights of unit gain, so that activations stay of order one.
pub(crate) fn layers(seed: u64, hidden: usize, width: usize) -> Layers {
    let mut rng = Pcg64::seed_from_u64(seed);
    let mut dense = |inputs: usize, outputs: usize| {
        let scale = (6.0 / inputs as f32).sqrt();
        Dense {
            inputs,
            outputs,
            weight: (0..inputs * outputs).map(|_| rng.random_range(-scale..scale)).collect(),
            bias: (0..outputs).map(|_| rng.random_range(-0.1..0.1)).collect(),
        }
    };
    let mut network = |inputs: usize, outputs: usize| {
        let mut layers = vec![dense(inputs, width)];
        layers.extend((1..hidden).map(|_| dense(width, width)));
        layers.push(dense(width, outputs));
        layers
    };
    Layers { human: network(12, LATENT), robot: network(5, LATENT), decoder: network(LATENT, 5) }
}

pub(crate) fn weights(layers: &Layers) -> Weights {
    let (bytes, manifest) = write_weights(layers, &Manifest::new(&identity(), layers)).expect("written");
    Weights::read(&manifest, &bytes, &identity()).expect("accepted")
}

/// The shipped prediction.
pub(crate) fn prediction() -> Prediction {
    let [manifest, tensors] = prediction_files();
    Prediction::read(std::str::from_utf8(&manifest).expect("text"), &tensors).expect("accepted")
}

/// Manifest and tensors of the shipped prediction.
pub(crate) fn prediction_files() -> [Vec<u8>; 2] {
    let base = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../weights/prediction");
    ["toml", "safetensors"].map(|extension| std::fs::read(base.with_extension(extension)).expect("shipped"))
}

/// Outputs of the ticks of this time, each with the newest skeleton. Of so many ticks only one is run, as by a process that is
/// late.
pub(crate) fn run_every(every: usize, config: &Config, skeletons: &[Skeleton], seconds: f64) -> Vec<(Stamp, Output)> {
    let first = tick_at(Stamp(START_NS)) + 1;
    let (mut state, mut next) = (State::default(), 0);
    (first..first + (seconds * 1500.0) as u64)
        .step_by(every)
        .map(|k| {
            let now = deadline(k);
            while skeletons.get(next).is_some_and(|skeleton| skeleton.received <= now) {
                next += 1;
            }
            let skeleton = next.checked_sub(1).map(|i| &skeletons[i]);
            (now, tick(config, &mut state, now, Input { k, skeleton }))
        })
        .collect()
}

/// A skeleton whose two arms have the postures `q` (both arms by the model of the left one).
pub(crate) fn skeleton(sequence: u64, received_ns: u64, origin_ns: u64, q: &[ArmQ; 2]) -> Skeleton {
    skeleton_of_limbs(sequence, received_ns, origin_ns, &q.map(|q| arm().forward(&q)))
}

/// A skeleton of both arms, each as a left one.
pub(crate) fn skeleton_of_limbs(sequence: u64, received_ns: u64, origin_ns: u64, arms: &[Limbs; 2]) -> Skeleton {
    let mut out = Skeleton { received: Stamp(received_ns), flags: skeleton_flag::ALL, ..Skeleton::ZERO };
    out.header.sequence = sequence;
    out.header.incarnation = 1;
    out.header.origin = Stamp(origin_ns);
    for (n, limbs) in arms.iter().enumerate() {
        for (i, rotation) in [limbs.upper, limbs.fore].iter().enumerate() {
            let left = xyzw_from_rotation(rotation);
            out.limbs[2 * n + i] = if n == 0 { left } else { mirror(left) }.map(|x| x as f32);
        }
    }
    out
}
