//! What the stage is built from: limits with the planning margin, the collision model, and the switches of the tests.

use crate::chain::{BODIES, Chain};
use crate::dynamics::Mass;
use crate::geometry::{BodyCapsule, Geometry};
use crate::hand::HandSpeed;
use crate::interface::Interface;
use crate::interval::Bounds;
use crate::torque::Load;
use messages::{JOINTS, LEFT_ARM, RIGHT_ARM};
use robot::{Payload, Solid};
use thiserror::Error;

/// Share of acceleration and jerk limits that is planned with, so that rounding at the gate never denies an honest command.
pub const PLANNED_SHARE: f64 = 0.995;
/// The same of velocity limits, less what a servo overshoots that the other joints push: the simulated one was seen to exceed a
/// speed by 5 %, which is what its judge grants.
pub const PLANNED_SPEED_SHARE: f64 = 0.98;
/// The same behind the forearm. Wrists are light, and the arm pushes them: planned with 0.90 a simulated one reached 1.0513 of its
/// limit under `torture` (one sample in ten million ticks), so 1.05 - (1.0513 - 0.90), and 0.02 less for what is rarer still.
pub const PLANNED_WRIST_SPEED_SHARE: f64 = 0.88;
/// Joints of an arm before its wrist.
const BEFORE_WRIST: usize = 4;
/// Distance kept from position limits, rad or m: far above the rounding of a stop's end, far below any encoder.
const POSITION_INSET: f64 = 1e-6;
/// The same behind the forearm, rad. The arm pushes wrists out of their limits too: a simulated one went 4.02 mrad beyond the
/// position it was told under `torture` (once in 4 million ticks), where the robot's judge grants 4. Half of that again.
const WRIST_POSITION_INSET: f64 = 2e-3;
/// Added to d_min, m: rounding and quantisation at the gate, which checks clearance with arithmetic of its own.
const CLEARANCE_INSET_M: f64 = 1e-6;
/// Clearance beyond d_min that a resting posture must have before the robot may engage, m.
pub const ENGAGE_MARGIN_M: f64 = 3e-3;

/// Why a configuration was refused.
#[derive(Debug, Error, PartialEq)]
pub enum WbcError {
    /// A limit that bounds motion is missing or not positive.
    #[error("joint {joint}: {limit} = {value}, must be finite and above zero")]
    Limit {
        /// Index of the joint.
        joint: usize,
        /// Which limit.
        limit: &'static str,
        /// Its value, SI.
        value: f64,
    },
    /// A position range without room.
    #[error("joint {joint}: position range [{q_min}, {q_max}] is empty")]
    Range {
        /// Index of the joint.
        joint: usize,
        /// Lowest position.
        q_min: f64,
        /// Highest position.
        q_max: f64,
    },
    /// The home posture lies outside the limits.
    #[error("joint {joint}: home = {value} lies outside [{q_min}, {q_max}]")]
    Home {
        /// Index of the joint.
        joint: usize,
        /// Home position.
        value: f64,
        /// Lowest position.
        q_min: f64,
        /// Highest position.
        q_max: f64,
    },
    /// The kinematics are not a tree of 17 joints in order, or were not reproduced.
    #[error("joint {joint}: {what}")]
    Kinematics {
        /// Index of the joint.
        joint: usize,
        /// What is wrong.
        what: &'static str,
    },
    /// A capsule or a pair that the certificate cannot hold.
    #[error("collision model: {what} = {value}, at most {bound}")]
    Collision {
        /// What is too large.
        what: &'static str,
        /// Its value.
        value: usize,
        /// The bound.
        bound: usize,
    },
    /// An interface that no robot has, or whose deviation is too large.
    #[error("interface: {key} = {value}, must be 0 to {bound}")]
    Interface {
        /// Which figure.
        key: &'static str,
        /// Its value, SI.
        value: f64,
        /// The bound.
        bound: f64,
    },
    /// A bound on the speed of hands that leaves no motion.
    #[error("hand speed = {0} m/s, must be finite and above zero")]
    HandSpeed(f64),
    /// Masses or motors that no proof can be made with.
    #[error("body of joint {joint}: {what} = {value}, must be finite and not below zero")]
    Mass {
        /// Index of the joint that the body moves with.
        joint: usize,
        /// Which figure.
        what: &'static str,
        /// Its value, SI.
        value: f64,
    },
    /// The distance to keep is not a positive length.
    #[error("d_min_m = {0}, must be finite and above zero")]
    Clearance(f64),
}

/// Switches. The default is what a robot runs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    certificate: bool,
    torque: bool,
    interface: Interface,
    hand_speed_m_per_s: Option<f64>,
}

impl Default for Options {
    fn default() -> Self {
        Self { certificate: true, torque: true, interface: Interface::default(), hand_speed_m_per_s: None }
    }
}

impl Options {
    /// Without the certificate, so that a test can show that it is what prevents collisions.
    pub fn without_certificate_for_tests() -> Self {
        Self { certificate: false, ..Self::default() }
    }

    /// Without the proof of torques, so that a test can show that it is what keeps motors from being overloaded.
    pub fn without_torque_for_tests() -> Self {
        Self { torque: false, ..Self::default() }
    }

    /// For a robot that executes the commands through `interface`.
    pub fn interface(self, interface: Interface) -> Self {
        Self { interface, ..self }
    }

    /// Elbows and hands no faster than this in the base frame, m/s.
    pub fn hand_speed_m_per_s(self, max: f64) -> Self {
        Self { hand_speed_m_per_s: Some(max), ..self }
    }

    pub(crate) fn hand_speed(&self) -> Option<f64> {
        self.hand_speed_m_per_s
    }
}

/// What a deviation from the wish costs where the robot cannot do as it would like.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tasks {
    /// Per joint, for a deviation as large as its largest speed; above zero.
    pub joint_weight: [f64; JOINTS],
    /// For a deviation of a limb's angular velocity by 1 rad/s; 0 leaves the limbs out.
    pub limb_weight: f64,
    /// Bodies whose rotations are the limbs: of each arm the upper and the fore one.
    pub limb_bodies: [[usize; 2]; 2],
}

impl Tasks {
    /// Every joint counts the same, limbs do not.
    pub const JOINTS_ALIKE: Self = Self { joint_weight: [1.0; JOINTS], limb_weight: 0.0, limb_bodies: [[0; 2]; 2] };
}

/// Validated, immutable configuration of the stage.
#[derive(Clone, Debug)]
pub struct Config {
    /// What each joint is planned within.
    pub(crate) bounds: [Bounds; JOINTS],
    /// The position limits themselves.
    pub(crate) hard_range: [[f64; 2]; JOINTS],
    pub(crate) home: [f64; JOINTS],
    pub(crate) geometry: Geometry,
    pub(crate) tasks: Tasks,
    pub(crate) certificate: bool,
    /// Masses and motors, with what the hands carry at the start; none if nothing is to be proved of them.
    pub(crate) load: Option<Load>,
    /// No stop takes longer, s.
    pub(crate) stop_time_max_s: f64,
    /// The bound on elbows and hands; none if no motion within the limits could break it.
    pub(crate) hand: Option<HandSpeed>,
}

/// The parts of a robot that the stage needs, SI units.
#[derive(Clone, Debug)]
pub struct Parts {
    /// The kinematic tree.
    pub chain: Chain,
    /// The limits of each joint, without any planning margin.
    pub limits: [Bounds; JOINTS],
    /// Posture of joints without a target.
    pub home: [f64; JOINTS],
    /// Capsules on bodies.
    pub capsules: Vec<BodyCapsule>,
    /// Pairs of capsule indices that must stay apart.
    pub pairs: Vec<[usize; 2]>,
    /// Solids on the base that every capsule that moves must stay apart from.
    pub obstacles: Vec<Solid>,
    /// Distance that they keep, m.
    pub d_min_m: f64,
    /// What deviations cost.
    pub tasks: Tasks,
    /// Masses of the bodies; the base's does not matter.
    pub masses: [Mass; BODIES],
    /// What the left and the right hand carry at the start.
    pub payload: [Payload; 2],
    /// Largest torque or force of each motor, N m or N; infinite where it does not matter.
    pub effort_max: [f64; JOINTS],
    /// No stop takes longer, s.
    pub stop_time_max_s: f64,
}

impl Config {
    /// The configuration of a robot given by its parts.
    pub fn from_parts(parts: Parts, options: Options) -> Result<Self, WbcError> {
        for (joint, limits) in parts.limits.iter().enumerate() {
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
            bounds: std::array::from_fn(|j| planned(j, &parts.limits[j])),
            load: options.torque.then_some(load),
            stop_time_max_s: parts.stop_time_max_s,
            hard_range: parts.limits.map(|l| [l.q_min, l.q_max]),
            home: parts.home,
            geometry: Geometry::new(parts.chain, &parts.capsules, &parts.pairs, d_min_m)?
                .with_obstacles(&parts.obstacles)?
                .with_interface(&options.interface, &parts.limits)?,
            tasks: parts.tasks,
            certificate: options.certificate,
            hand: None,
        })
    }

    /// What each joint is planned within: position limits less a micrometre or microradian (a wrist's 2 mrad), speeds times
    /// [`PLANNED_SPEED_SHARE`] or [`PLANNED_WRIST_SPEED_SHARE`], the others times [`PLANNED_SHARE`].
    pub fn bounds(&self) -> &[Bounds; JOINTS] {
        &self.bounds
    }

    /// The collision model that is certified.
    pub fn geometry(&self) -> &Geometry {
        &self.geometry
    }
}

/// What joint `j` is planned within.
fn planned(j: usize, l: &Bounds) -> Bounds {
    let wrist = [LEFT_ARM, RIGHT_ARM].iter().any(|arm| arm.contains(&j) && j >= arm.start + BEFORE_WRIST);
    let (speed_share, inset) = match wrist {
        true => (PLANNED_WRIST_SPEED_SHARE, WRIST_POSITION_INSET),
        false => (PLANNED_SPEED_SHARE, POSITION_INSET),
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

fn check_masses(masses: &[Mass; BODIES], effort_max: &[f64; JOINTS]) -> Result<(), WbcError> {
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
