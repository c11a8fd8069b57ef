//! Configuration of the stage: limits with the planning margin, the collision model, and the switches for tests.

use crate::chain::{BODIES, KinematicChain};
use crate::dynamics::Mass;
use crate::geometry::{BodyCapsule, Geometry};
use crate::hand::HandSpeed;
use crate::interface::{Controllers, Interface};
use crate::interval::Bounds;
use crate::torque::Load;
use messages::JOINTS_MAX;
use robot::{Payload, Solid};
use thiserror::Error;

/// Share of acceleration and jerk limits that is used for planning. With it, rounding at the gate never
/// denies an honest command.
pub const PLANNED_SHARE: f64 = 0.995;
/// The same share of velocity limits. It allows for the overshoot of a servo that other joints push. The
/// simulated one was seen to exceed a speed by 5 %, which its judge allows.
pub const PLANNED_SPEED_SHARE: f64 = 0.98;
/// The same share behind the forearm. Wrists are light, and the arm pushes them. Planned with 0.90, a
/// simulated wrist reached 1.0513 of its limit under `torture` (one sample in ten million ticks). So the
/// share is 1.05 - (1.0513 - 0.90), and 0.02 less for rarer events.
pub const PLANNED_WRIST_SPEED_SHARE: f64 = 0.88;
/// The same share of a waist or torso that turns. Its arms push it. Planned with 0.98, RB-Y1's simulated torso reached
/// 1.175 of its limit under `torture` (one million ticks). So the share is 1.05 - (1.175 - 0.98), and 0.02 less for
/// rarer events.
pub const PLANNED_BODY_SPEED_SHARE: f64 = 0.83;
/// Distance kept from position limits, rad or m. It is far above the rounding of a stop's end, and far below
/// any encoder's resolution.
const POSITION_INSET: f64 = 1e-6;
/// The same behind the forearm, rad. The arm pushes wrists out of their limits too. Under `torture` a
/// simulated wrist went 4.02 mrad beyond its commanded position (once in 4 million ticks), and the robot's
/// judge allows 4. This value is half of that again.
const WRIST_POSITION_INSET: f64 = 2e-3;
/// Added to d_min, m, for rounding and quantisation at the gate, which computes clearance with its own code.
const CLEARANCE_INSET_M: f64 = 1e-6;
/// Clearance beyond d_min that a resting posture must have before the robot may engage, m.
pub const ENGAGE_MARGIN_M: f64 = 3e-3;

/// The reason why a configuration was refused. Numbers are SI.
#[derive(Debug, Error, PartialEq)]
#[allow(missing_docs, reason = "the texts name the fields")]
pub enum WbcError {
    /// Returned if a limit that bounds motion is not finite and positive.
    #[error("joint {joint}: {limit} = {value}, must be finite and above zero")]
    Limit { joint: usize, limit: &'static str, value: f64 },
    /// Returned if a position range is empty.
    #[error("joint {joint}: position range [{q_min}, {q_max}] is empty")]
    Range { joint: usize, q_min: f64, q_max: f64 },
    /// Returned if the home posture lies outside the limits.
    #[error("joint {joint}: home = {value} lies outside [{q_min}, {q_max}]")]
    Home { joint: usize, value: f64, q_min: f64, q_max: f64 },
    /// Returned if the kinematics are not a tree with the joints in order, or could not be reproduced.
    #[error("joint {joint}: {what}")]
    Kinematics { joint: usize, what: &'static str },
    /// Returned if the certificate cannot hold a capsule or a pair.
    #[error("collision model: {what} = {value}, at most {bound}")]
    Collision { what: &'static str, value: usize, bound: usize },
    /// Returned if a figure of the interface is outside its bound, or if the interface's deviation is too large.
    #[error("interface: {key} = {value}, must be 0 to {bound}")]
    Interface { key: &'static str, value: f64, bound: f64 },
    /// Returned if the bound on the speed of hands is not finite and positive, so that no motion would be left.
    #[error("hand speed = {0} m/s, must be finite and above zero")]
    HandSpeed(f64),
    /// Returned if a figure of masses or motors does not allow a proof.
    #[error("body of joint {joint}: {what} = {value}, must be finite and not below zero")]
    Mass {
        /// Index of the joint that the body moves with.
        joint: usize,
        what: &'static str,
        value: f64,
    },
    /// Returned if the distance to keep is not finite and positive.
    #[error("d_min_m = {0}, must be finite and above zero")]
    Clearance(f64),
}

/// Switches. A robot runs with the default.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    certificate: bool,
    torque: bool,
    skips: bool,
    interface: Interface,
    hand_speed_m_per_s: Option<f64>,
}

impl Default for Options {
    fn default() -> Self {
        let (interface, hand_speed_m_per_s) = (Interface::default(), None);
        Self { certificate: true, torque: true, skips: true, interface, hand_speed_m_per_s }
    }
}

impl Options {
    /// Switches the certificate off, so that a test can show that it prevents collisions.
    pub fn without_certificate_for_tests() -> Self {
        Self { certificate: false, ..Self::default() }
    }

    /// Switches the proof of torques off, so that a test can show that it prevents overloaded motors.
    pub fn without_torque_for_tests() -> Self {
        Self { torque: false, ..Self::default() }
    }

    /// Measures every pair in every tick, so that a test can compare the decisions.
    pub fn without_skips_for_tests() -> Self {
        Self { skips: false, ..Self::default() }
    }

    /// Sets the interface through which the robot executes the commands.
    pub fn interface(self, interface: Interface) -> Self {
        Self { interface, ..self }
    }

    /// Sets the largest speed of elbows and hands in the base frame, m/s.
    pub fn hand_speed_m_per_s(self, max: f64) -> Self {
        Self { hand_speed_m_per_s: Some(max), ..self }
    }

    pub(crate) fn hand_speed(&self) -> Option<f64> {
        self.hand_speed_m_per_s
    }
}

/// Costs of a deviation where the robot cannot move as wanted.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tasks {
    /// Per joint, the cost of a deviation as large as its largest speed. It must be above zero.
    pub joint_weight: [f64; JOINTS_MAX],
    /// Cost of a deviation of a limb's angular velocity by 1 rad/s. 0 leaves the limbs out.
    pub limb_weight: f64,
    /// Bodies whose rotations are the limbs: the upper arm and the forearm of each arm.
    pub limb_bodies: [[usize; 2]; 2],
}

/// Validated, immutable configuration of the stage.
#[derive(Clone, Debug)]
pub struct Config {
    /// The bounds within which each joint is planned.
    pub(crate) bounds: [Bounds; JOINTS_MAX],
    /// The position limits themselves.
    pub(crate) hard_range: [[f64; 2]; JOINTS_MAX],
    pub(crate) home: [f64; JOINTS_MAX],
    pub(crate) geometry: Geometry,
    pub(crate) tasks: Tasks,
    pub(crate) certificate: bool,
    /// Masses and motors, with the payload of the hands at the start. None if no torque is to be proved.
    pub(crate) load: Option<Load>,
    /// Longest duration of a stop, s.
    pub(crate) stop_time_max_s: f64,
    /// The bound on elbows and hands. None if no motion within the limits could exceed it.
    pub(crate) hand: Option<HandSpeed>,
}

/// The parts of a robot that the stage needs, SI units.
#[derive(Clone, Debug)]
pub struct Parts {
    /// The kinematic tree.
    pub chain: KinematicChain,
    /// The robot's controllers.
    pub controllers: Controllers,
    /// The limits of each joint, without any planning margin.
    pub limits: [Bounds; JOINTS_MAX],
    /// Posture of joints without a target.
    pub home: [f64; JOINTS_MAX],
    /// Capsules on bodies.
    pub capsules: Vec<BodyCapsule>,
    /// Pairs of capsule indices that must stay apart.
    pub pairs: Vec<[usize; 2]>,
    /// Solids on the base. Every moving capsule must stay apart from them.
    pub obstacles: Vec<Solid>,
    /// Distance that they keep, m.
    pub d_min_m: f64,
    /// Costs of deviations.
    pub tasks: Tasks,
    /// Masses of the bodies. The base's mass does not matter.
    pub masses: [Mass; BODIES],
    /// Payload of the left and the right hand at the start.
    pub payload: [Payload; 2],
    /// Largest torque or force of each motor, N m or N. Infinite where it does not matter.
    pub effort_max: [f64; JOINTS_MAX],
    /// Longest duration of a stop, s.
    pub stop_time_max_s: f64,
}

impl Config {
    /// Creates the configuration of a robot from its parts.
    pub fn from_parts(parts: Parts, options: Options) -> Result<Self, WbcError> {
        for (joint, limits) in parts.limits.iter().enumerate().take(parts.chain.count()) {
            check_limits(joint, limits, parts.home[joint])?;
        }
        if !(parts.d_min_m.is_finite() && parts.d_min_m > 0.0) {
            return Err(WbcError::Clearance(parts.d_min_m));
        }
        check_masses(&parts.masses, &parts.effort_max)?;
        let d_min_m = parts.d_min_m + CLEARANCE_INSET_M;
        let mut load = Load::new(&parts.chain, &parts.masses, &parts.effort_max)?;
        load.carry(&parts.payload);
        Ok(Self {
            bounds: std::array::from_fn(|j| planned(&parts.chain, j, &parts.limits[j])),
            load: options.torque.then_some(load),
            stop_time_max_s: parts.stop_time_max_s,
            hard_range: parts.limits.map(|l| [l.q_min, l.q_max]),
            home: parts.home,
            geometry: Geometry::new(parts.chain, &parts.capsules, &parts.pairs, d_min_m)?
                .with_obstacles(&parts.obstacles)?
                .with_interface(&options.interface, &parts.controllers, &parts.limits)?
                .with_skips(options.skips),
            tasks: parts.tasks,
            certificate: options.certificate,
            hand: None,
        })
    }

    /// The bounds within which each joint is planned. Position limits are reduced by a micrometre or
    /// microradian (a wrist's by 2 mrad). Speeds are multiplied by [`PLANNED_SPEED_SHARE`],
    /// [`PLANNED_WRIST_SPEED_SHARE`] or [`PLANNED_BODY_SPEED_SHARE`], and the others by [`PLANNED_SHARE`].
    pub fn bounds(&self) -> &[Bounds; JOINTS_MAX] {
        &self.bounds
    }

    /// Number of joints.
    #[inline]
    pub(crate) fn count(&self) -> usize {
        self.geometry.chain.count()
    }

    /// The collision model of the certificate.
    pub fn geometry(&self) -> &Geometry {
        &self.geometry
    }
}

/// Returns true if the joint turns the shoulders.
fn turns_shoulders(chain: &KinematicChain, j: usize) -> bool {
    let [left, right] = chain.arms();
    let before_hands = chain.hands().iter().fold(0, |all, &hand| all | chain.ancestors(hand));
    before_hands & !(left | right) & 1 << j != 0 && !chain.links()[j].prismatic
}

/// The bounds within which joint `j` is planned.
fn planned(chain: &KinematicChain, j: usize, l: &Bounds) -> Bounds {
    let (speed_share, inset) = if chain.is_behind_elbow(j) {
        (PLANNED_WRIST_SPEED_SHARE, WRIST_POSITION_INSET)
    } else if turns_shoulders(chain, j) {
        (PLANNED_BODY_SPEED_SHARE, POSITION_INSET)
    } else {
        (PLANNED_SPEED_SHARE, POSITION_INSET)
    };
    Bounds {
        q_min: l.q_min + inset,
        q_max: l.q_max - inset,
        v_max: speed_share * l.v_max,
        a_max: PLANNED_SHARE * l.a_max,
        brake: PLANNED_SHARE * l.brake,
        j_max: PLANNED_SHARE * l.j_max,
    }
}

fn check_masses(masses: &[Mass; BODIES], effort_max: &[f64; JOINTS_MAX]) -> Result<(), WbcError> {
    for (joint, (mass, effort)) in masses[1..].iter().zip(effort_max).enumerate() {
        let refuse = |what, value| Err(WbcError::Mass { joint, what, value });
        if !(mass.mass_kg.is_finite() && mass.mass_kg >= 0.0) {
            return refuse("mass_kg", mass.mass_kg);
        }
        let figures = mass.center.iter().chain(mass.about_center.iter());
        if let Some(&value) = figures.clone().find(|value| !value.is_finite()) {
            return refuse("centre or inertia", value);
        }
        if effort.is_nan() || *effort <= 0.0 {
            return refuse("effort_max", *effort);
        }
    }
    Ok(())
}

fn check_limits(joint: usize, l: &Bounds, home: f64) -> Result<(), WbcError> {
    for (limit, value) in [("v_max", l.v_max), ("a_max", l.a_max), ("brake", l.brake), ("j_max", l.j_max)] {
        if !(value.is_finite() && value > 0.0) {
            return Err(WbcError::Limit { joint, limit, value });
        }
    }
    let (q_min, q_max) = (l.q_min, l.q_max);
    if !(q_min.is_finite() && q_max.is_finite() && q_max - q_min > 4.0 * WRIST_POSITION_INSET) {
        return Err(WbcError::Range { joint, q_min, q_max });
    }
    if !(home >= q_min && home <= q_max) {
        return Err(WbcError::Home { joint, value: home, q_min, q_max });
    }
    Ok(())
}
