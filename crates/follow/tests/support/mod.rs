//! An arm like TIAGo's with its own limits, and a robot whose command equals the aim.
#![allow(dead_code, reason = "every test file uses a part of it")]

use follow::arm::{Arm, ArmVector, Limbs};
use follow::gap::Gaps;
use follow::solver::{Bounds, Problem, State as ArmState};
use follow::{Config, Input, LIMB_JOINTS, NODES, Output, State, Weights, tick};
use messages::{HAND_NODES, JOINTS_MAX, LIMBS, TRAJECTORY_NODE_TICKS};
use nalgebra::{UnitQuaternion, Vector3};
use rand::RngExt;
use rand_pcg::Pcg64;
use robot::{Frames, Model, segment_distance};
use std::f64::consts::FRAC_PI_2;

/// TIAGo++: the joints of its left arm.
const LEFT_ARM: std::ops::Range<usize> = 3..10;
/// TIAGo++: the joints of its right arm.
const RIGHT_ARM: std::ops::Range<usize> = 10..17;

/// Speeds and accelerations of these tests, independent of the robot file: rad/s, rad/s^2.
pub const V_MAX: f64 = 2.0;
pub const A_MAX: f64 = 10.0;
pub const FIRST: [usize; 2] = [LEFT_ARM.start, RIGHT_ARM.start];
/// A posture away from the gimbal and from all limits.
pub const FREE: [f64; LIMB_JOINTS] = [0.3, 0.3, 1.5, 1.0, 0.2];

/// Joints of both arms that turn limbs.
pub const LIMB_MASK: u32 = ((1 << LIMB_JOINTS) - 1) << FIRST[0] | ((1 << LIMB_JOINTS) - 1) << FIRST[1];

pub type Trajectory = [[[f32; 4]; LIMBS]; NODES];

/// Axes, reference and ranges of a TiaGo++.
pub fn arm() -> Arm {
    let (x, y, z) = (Vector3::x(), Vector3::y(), Vector3::z());
    Arm::new([-z, -x, y, -z, -y], [0.0, 0.0, FRAC_PI_2, 0.0, 0.0], [y * 0.125, y * 0.09, y * 0.221, y * 0.0, y * 0.41])
}

pub fn bounds() -> Bounds {
    Bounds {
        q_min: ArmVector::from([-1.178, -1.178, -0.785, -0.393, -2.094]),
        q_max: ArmVector::from([1.571, 1.571, 3.927, 2.356, 2.094]),
        v_max: ArmVector::repeat(V_MAX),
        a_max: ArmVector::repeat(A_MAX),
    }
}

/// A problem from rest at `q`, with a person who stands.
pub fn problem(q: ArmVector, person: Limbs) -> Problem {
    Problem {
        start: ArmState { q, v: ArmVector::zeros() },
        interval_s: [0.02; NODES],
        person: [person; NODES],
        weight: [1.0; NODES],
        prior: q,
        pull: 0.0,
        bounds: bounds(),
        gaps: Gaps::none(),
        places: [None; NODES],
    }
}

/// The shipped robot, with the speeds and accelerations of these tests.
pub fn model() -> Model {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/../../config/robots/");
    let read = |name: &str| std::fs::read_to_string(format!("{folder}{name}")).expect("shipped with the repository");
    let (toml, urdf) = (read("tiago_dual.toml"), read("tiago_dual.urdf"));
    let mut model = Model::from_text("tiago_dual.toml", &toml, "tiago_dual.urdf", &urdf).expect("the shipped robot");
    for first in FIRST {
        for limits in &mut model.limits[first..first + LIMB_JOINTS] {
            (limits.v_max, limits.a_max) = (V_MAX, A_MAX);
        }
    }
    model
}

/// Smallest distance of the checked pairs whose distance a limb's joint changes, m. With `hands`, of all pairs.
pub fn clearance_m(model: &Model, q: &[f64; JOINTS_MAX], hands: bool) -> f64 {
    let mut frames = Frames::default();
    model.forward(q, &mut frames);
    let is_hand = |capsule: usize| {
        let body = model.capsules[capsule].body;
        FIRST.iter().any(|first| (first + LIMB_JOINTS + 1..=first + 7).contains(&body))
    };
    let pairs = model.pairs.iter().filter(|pair| hands || !(is_hand(pair.a) || is_hand(pair.b)));
    pairs.map(|pair| distance_m(model, &frames, pair)).fold(f64::INFINITY, f64::min)
}

/// Distance of a pair with the bodies at `frames`, m.
pub fn distance_m(model: &Model, frames: &Frames, pair: &robot::Pair) -> f64 {
    let [a, b] = [pair.a, pair.b].map(|capsule| {
        let capsule = &model.capsules[capsule];
        let pose = &frames.base_from_body[capsule.body];
        (pose.transform_point(&capsule.a), pose.transform_point(&capsule.b), capsule.radius_m)
    });
    segment_distance(&a.0, &a.1, &b.0, &b.1).distance_m - a.2 - b.2
}

/// The home posture with both arms at `q`.
pub fn posture(model: &Model, q: &[f64; LIMB_JOINTS]) -> [f64; JOINTS_MAX] {
    let mut all = model.home;
    for first in FIRST {
        all[first..first + LIMB_JOINTS].copy_from_slice(q);
    }
    all
}

pub fn random_q(rng: &mut Pcg64) -> ArmVector {
    let bounds = bounds();
    ArmVector::from_fn(|j, _| rng.random_range(bounds.q_min[j]..bounds.q_max[j]))
}

pub fn random_rotation(rng: &mut Pcg64) -> UnitQuaternion<f64> {
    let axis = Vector3::from_fn(|_, _| rng.random_range(-1.0..1.0)).normalize();
    UnitQuaternion::from_scaled_axis(axis * rng.random_range(0.0..3.1))
}

/// Returns the rotation, turned by `angle` about a random axis.
pub fn turned(rng: &mut Pcg64, rotation: &UnitQuaternion<f64>, angle: f64) -> UnitQuaternion<f64> {
    let axis = Vector3::from_fn(|_, _| rng.random_range(-1.0..1.0)).normalize();
    UnitQuaternion::from_scaled_axis(axis * angle) * rotation
}

/// One arm's limbs in the message's format.
pub fn to_message(limbs: &Limbs, arm: usize) -> [[f32; 4]; 2] {
    [limbs.upper, limbs.fore].map(|limb| {
        let [x, y, z, w] = [limb.i, limb.j, limb.k, limb.w].map(|x| x as f32);
        if arm == 0 { [x, y, z, w] } else { [-x, y, -z, w] }
    })
}

/// The nodes from `first` on, with the limbs of both arms at each node.
pub fn limb_trajectory(first: u64, person: impl Fn(u64) -> [Limbs; 2]) -> Trajectory {
    std::array::from_fn(|i| {
        let [left, right] = person(first + i as u64);
        let ([a, b], [c, d]) = (to_message(&left, 0), to_message(&right, 1));
        [a, b, c, d]
    })
}

/// Time of a node, s.
pub fn node_s(node: u64) -> f64 {
    (node * TRAJECTORY_NODE_TICKS) as f64 * messages::TICK_S
}

/// A robot whose command is the aim of the previous tick.
pub struct Robot {
    pub config: Config,
    pub state: State,
    pub k: u64,
    pub q: [f64; JOINTS_MAX],
    pub v: [f64; JOINTS_MAX],
    pub prior: [f64; JOINTS_MAX],
    pub hands: [[[f32; 4]; 2]; HAND_NODES],
    pub valid_mask: u32,
    /// At every node.
    pub places: [[f32; 4]; 2],
    pub speed_scale: f64,
}

impl Robot {
    /// Starts at rest with both arms at `q`, which retargeting proposes as well. Its parts may pass through each
    /// other, so that a person may stand in any posture.
    pub fn at(q: &[f64; LIMB_JOINTS], weights: Weights) -> Self {
        let mut model = model();
        model.pairs.clear();
        Self::of_model(&model, q, weights)
    }

    /// The same with parts that must not touch.
    pub fn solid(q: &[f64; LIMB_JOINTS], weights: Weights) -> Self {
        Self::of_model(&model(), q, weights)
    }

    fn of_model(model: &Model, q: &[f64; LIMB_JOINTS], weights: Weights) -> Self {
        let all = posture(model, q);
        Self {
            config: Config::new(model, &model.limits.each_ref().map(|limits| 0.98 * limits.v_max), weights),
            state: State::default(),
            k: 7_500_017,
            q: all,
            v: [0.0; JOINTS_MAX],
            prior: all,
            hands: [[[0.0; 4]; 2]; HAND_NODES],
            valid_mask: LIMB_MASK,
            places: [[0.0; 4]; 2],
            speed_scale: 1.0,
        }
    }

    pub fn propose(&mut self, q: &[f64; LIMB_JOINTS]) {
        for first in FIRST {
            self.prior[first..first + LIMB_JOINTS].copy_from_slice(q);
        }
    }

    /// First node in a target of the next tick.
    pub fn next_first(&self) -> u64 {
        (self.k + 1) / TRAJECTORY_NODE_TICKS + 1
    }

    /// Runs a tick `ticks` later, with this trajectory from node `trajectory_first`. In the ticks between, joints keep their
    /// speed.
    pub fn step_after(&mut self, ticks: u64, trajectory: &Trajectory, trajectory_first: u64) -> Output {
        self.k += ticks;
        for (q, v) in self.q.iter_mut().zip(&self.v) {
            *q += v * ticks.saturating_sub(1) as f64 * messages::TICK_S;
        }
        let input = Input {
            places: &[self.places; NODES],
            k: self.k,
            limb_trajectory: trajectory,
            trajectory_first,
            valid_mask: self.valid_mask,
            prior: &self.prior,
            hands: &self.hands,
            q: &self.q,
            v: &self.v,
            speed_scale: self.speed_scale,
            wrist_speed_scale: self.speed_scale,
        };
        let output = tick(&self.config, &mut self.state, input);
        for (j, aim) in output.aims.iter().enumerate() {
            if let Some(aim) = aim {
                (self.q[j], self.v[j]) = (aim.q, aim.v);
            }
        }
        output
    }

    /// Runs the next tick with this person.
    pub fn step(&mut self, person: impl Fn(u64) -> [Limbs; 2]) -> Output {
        let first = self.next_first();
        self.step_after(1, &limb_trajectory(first, person), first)
    }

    pub fn arm(&self, arm: usize) -> ArmVector {
        ArmVector::from_fn(|j, _| self.q[FIRST[arm] + j])
    }

    pub fn speed(&self) -> f64 {
        self.v.iter().fold(0.0, |most, v| v.abs().max(most))
    }
}
