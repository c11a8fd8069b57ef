//! Conversion of a robot model for the retargeting.

use nalgebra::Vector3;
use robot::limbs::{axis_on_side, place_on_side};
use robot::{Frames, Model, segment_distance};

use crate::arm::{ARM_Q, ARMS, ArmModel};
use crate::config::{Config, ConfigError, RobotArms, Settings};
use crate::contact::{Correction, Part, Proportions};
use crate::height::Lift;
use crate::kinematic_chain::KinematicChain;
use crate::surface::Surface;
use crate::weights::{ArmIdentity, Weights};
use perceptron::WeightsError;

/// Numbers are rounded to this before they enter the hash, rad (axes: dimensionless). It is coarser than the
/// rounding of a sine on another machine, and finer than any change that matters.
const HASH_GRAIN: f64 = 1e-7;

/// Steps in which the chest's surface is searched, and their length, m: half a metre, to a millimetre.
const CHEST_STEPS: u32 = 500;
const CHEST_STEP_M: f64 = 1e-3;
/// Height against the shoulders below which a capsule must reach to be a part of the torso's front, m. What holds the shoulders
/// does not (assumption).
const TORSO_M: f64 = -0.1;

impl ArmModel {
    /// Takes the left (0) or the right arm (1) of `model` as a left arm: see [`Model::as_left`].
    pub fn from_model(model: &Model, side: usize) -> Self {
        let arm = model.as_left(side);
        let limit = |bound: fn(&robot::JointLimits) -> f64| arm.limb_values(&model.limits.each_ref().map(bound));
        Self::new(arm.axes, arm.reference, limit(|limits| limits.q_min), limit(|limits| limits.q_max))
    }

    /// Both arms of `model`.
    pub fn both(model: &Model) -> [Self; ARMS] {
        [0, 1].map(|side| Self::from_model(model, side))
    }
}

impl Proportions {
    /// Measures `model` as one arm sees it, with the torso and both wrists at home. See [`Model::as_left`].
    pub fn from_model(model: &Model, side: usize) -> Self {
        let side = model.measured_side(side);
        let arm = &model.arms[side];
        let mut frames = Frames::default();
        model.forward(&model.t_pose(), &mut frames);
        let shoulder = |side: usize| frames.base_from_body[model.arms[side].range().start + 2].t;
        let middle = (shoulder(0) + shoulder(1)) / 2.0;
        let torso_from_base = model.base_from_torso(&frames).transpose();
        let own = |at: Vector3<f64>| place_on_side(side, torso_from_base * (at - middle));
        let [left, right] = [0, 1].map(|side| model.limb_places(&frames, model.measured_side(side)).map(own));
        let length_m = |at: &[Vector3<f64>; ARM_Q + 1]| (at[3] - at[1]).norm() + (at[ARM_Q] - at[3]).norm();
        let reach_m = length_m(&left).min(length_m(&right));
        let places = if side == 0 { left } else { right };
        let (hand, joints) = (places[ARM_Q], std::array::from_fn(|slot| places[slot]));
        let surface = |bodies: &[usize], center: Vector3<f64>| {
            let capsules = model.capsules.iter().filter(|capsule| bodies.contains(&capsule.body));
            Surface::new(capsules.map(|capsule| (capsule.ends(&frames).map(|end| own(end) - center), capsule.radius_m)))
        };
        let mut wrist = model.wrists[side];
        wrist.axes = wrist.axes.map(|axis| axis_on_side(side, axis));
        let wrist_at = wrist.joints[0].map_or(hand, |joint| own(frames.base_from_body[joint + 1].t));
        let head = model.head.as_ref().and_then(|head| {
            let body = head.joints[1]? + 1;
            let middles = model.capsules.iter().filter(|capsule| capsule.body == body);
            let middles = middles.map(|capsule| (capsule.a + capsule.b) / 2.0);
            let (sum, count) = middles.fold((Vector3::zeros(), 0), |(sum, count), middle| (sum + middle, count + 1));
            let center = || own(frames.base_from_body[body].transform_point(&(sum / f64::from(count))));
            (count > 0).then(center).map(|center| Part { center, surface: surface(&[body], center) })
        });
        let chest_m = chest_m(model, &frames, middle);
        let torso_m = torso_m(model, &frames, own);
        Self {
            chain: KinematicChain { joints, hand },
            wrist,
            wrist_at,
            head,
            reach_m,
            hand: surface(&[arm.hand_body()], hand),
            forearm: surface(&Vec::from_iter(arm.slots[3..ARM_Q].iter().flatten().map(|joint| joint + 1)), wrist_at),
            chest_m,
            torso_m,
        }
    }
}

impl Correction {
    /// The correction for the arms of `model`.
    pub fn from_model(model: &Model, weight: f64) -> Self {
        Self { robot: [0, 1].map(|side| Proportions::from_model(model, side)), weight }
    }
}

/// Returns how far the torso reaches before the middle between the shoulders and to its left, m. `own`: the place in the torso
/// frame from there.
fn torso_m(model: &Model, frames: &Frames, own: impl Fn(Vector3<f64>) -> Vector3<f64>) -> [f64; 2] {
    let torso = model.capsules.iter().filter(|capsule| capsule.body == model.torso_body);
    let below = torso.filter(|capsule| capsule.ends(frames).iter().any(|end| own(*end).z < TORSO_M));
    let ends = below.flat_map(|capsule| capsule.ends(frames).map(|end| own(end) + Vector3::repeat(capsule.radius_m)));
    ends.fold([0.0; 2], |[x, y], end| [end.x.max(x), end.y.max(y)])
}

/// Returns how far the torso's surface is before `from`, in the direction x of the torso, m. Zero if it is not there.
fn chest_m(model: &Model, frames: &Frames, from: Vector3<f64>) -> f64 {
    let ahead = model.base_from_torso(frames) * Vector3::x();
    let torso = || model.capsules.iter().filter(|capsule| capsule.body == model.torso_body);
    let inside = |at: Vector3<f64>| {
        torso().any(|capsule| {
            let [a, b] = capsule.ends(frames);
            segment_distance(&at, &at, &a, &b).distance_m < capsule.radius_m
        })
    };
    let steps = (0..=CHEST_STEPS).rev().map(|step| f64::from(step) * CHEST_STEP_M);
    steps.into_iter().find(|along_m| inside(from + ahead * *along_m)).unwrap_or(0.0)
}

impl ArmIdentity {
    /// Returns the identity that weights for an arm of `model` must match. The hash covers what a network learns: joint
    /// names, axes, reference and limits of the arm. It leaves out the rest of the robot file, so a new collision
    /// capsule needs no new weights.
    pub fn from_model(model: &Model, side: usize) -> Self {
        let arm = ArmModel::from_model(model, side);
        let name = |joint: Option<usize>| joint.map_or_else(String::new, |joint| model.joint_names[joint].clone());
        let joints: [String; ARM_Q] = std::array::from_fn(|j| name(model.as_left(side).slots[j]));
        let numbers = arm.axes.iter().flatten().chain(&arm.reference).chain(&arm.q_min).chain(&arm.q_max);
        let numbers = numbers.flat_map(|x| ((x / HASH_GRAIN).round() as i64).to_le_bytes());
        let names = joints.iter().flat_map(|name| name.bytes().chain([0]));
        Self { robot: model.name.clone(), robot_hash: fnv(names.chain(numbers)), joints, arm }
    }
}

/// FNV-1a, 64 bit (offset basis and prime as published by Fowler, Noll and Vo).
fn fnv(bytes: impl Iterator<Item = u8>) -> u64 {
    bytes.fold(0xcbf2_9ce4_8422_2325, |hash, byte| (hash ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3))
}

impl RobotArms {
    /// Takes the data of `model` that a tick needs.
    pub fn from_model(model: &Model) -> Self {
        let speeds = model.limits.map(|limits| limits.v_max);
        Self {
            arms: ArmModel::both(model),
            velocity_max: [0, 1].map(|side| model.as_left(side).limb_values(&speeds)),
            home: model.home,
            robot: model.id(),
            joints: model.arms.each_ref().map(|arm| std::array::from_fn(|j| arm.slots[j])),
            signs: model.arms.each_ref().map(|arm| std::array::from_fn(|j| arm.signs[j])),
            wrists: model.wrists,
            head: model.head,
            lift: model.lift.map(|joint| {
                let limits = &model.limits[joint];
                Lift { joint, home: model.home[joint], q_min: limits.q_min, v_max: limits.v_max }
            }),
            proportions: Correction::from_model(model, 0.0).robot,
        }
    }
}

impl Weights {
    /// Reads a weights file (manifest text and safetensors bytes) for an arm of `model`. See `Weights::read`.
    pub fn from_bytes(text: &str, bytes: &[u8], model: &Model, side: usize) -> Result<Self, WeightsError> {
        Self::read(text, bytes, &ArmIdentity::from_model(model, side))
    }
}

impl Config {
    /// Checks the settings. See `Config::for_arms`.
    pub fn new(model: &Model, weights: Option<Weights>, settings: &Settings) -> Result<Self, ConfigError> {
        Self::for_arms(&RobotArms::from_model(model), weights, settings)
    }
}
