//! Configuration of the stage: the robot's arms, and the options of the user.

use messages::{JOINTS_MAX, RobotId};
use robot::TwoAxes;
use serde::Deserialize;

use crate::arm::{ARM_Q, ARMS, ArmModel, ArmQ};
use crate::contact::{Correction, Proportions};
use crate::height::Lift;
use crate::posture::PostureSolver;
use crate::prediction::Prediction;
use crate::resample::DELAY_MAX_NS;
use crate::weights::{ArmIdentity, Weights};

/// Largest number of refinement steps in a tick: about 0.3 us each (measured 2026-11-21), so the tick stays
/// bounded.
pub const REFINE_STEPS_MAX: u32 = 16;
/// Source of a posture before it is refined.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Method {
    /// Through the shared latent space.
    Network,
    /// By geometry: the baseline.
    ClosedForm,
}

/// Options of the user.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Options {
    /// `None` stands for `Network` if there are weights, else `ClosedForm`.
    pub method: Option<Method>,
    /// Levenberg-Marquardt steps per arm and tick, 0 to `REFINE_STEPS_MAX`.
    pub refine_steps: u32,
    /// Time from the capture of a person to the command that stands for it, ms, 0 to 250. The skeletons of that
    /// time are the way ahead. The longer it is, the nearer the robot follows.
    pub following_delay_ms: f64,
    /// The arms that follow, left and right. The other one keeps its home posture.
    pub arms: [bool; ARMS],
    /// The lift follows the person's height.
    pub lift_follows: bool,
    /// How much hands that touch turn the limbs, 0 to 1. See [`contact`](crate::contact).
    pub contact_weight: f64,
}

impl Default for Options {
    /// Two steps: more steps gain less than 0.02 degrees (`eval`). 120 ms: see the comparison of `eval
    /// --following`. No contacts: they cost 5 degrees of the limbs in clips of everyday motion.
    fn default() -> Self {
        Self {
            method: None,
            refine_steps: 2,
            following_delay_ms: 120.0,
            arms: [true; ARMS],
            lift_follows: false,
            contact_weight: 0.0,
        }
    }
}

/// Reason for which a configuration was refused.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs, reason = "the texts name the fields")]
pub enum ConfigError {
    /// The network was asked for and there is none.
    #[error("method is network, but no weights are given")]
    NoWeights,
    /// A number is out of its range.
    #[error("{key} is {value}, must be {min} to {max}")]
    Range { key: &'static str, value: f64, min: f64, max: f64 },
}

/// Data of the robot that a tick needs.
#[derive(Clone, Debug)]
pub struct RobotArms {
    /// Identity and model of the left arm. The right arm is its mirror.
    pub identity: ArmIdentity,
    /// Velocity limits of joints 1 to 5, rad/s.
    pub velocity_max: ArmQ,
    /// Home posture of all joints. The target shows it for a joint that is not valid.
    pub home: [f64; JOINTS_MAX],
    /// Number and order of the robot's joints.
    pub robot: RobotId,
    /// Indices of joints 1 to 5 of the left and the right arm.
    pub joints: [[usize; ARM_Q]; ARMS],
    /// Signs of these joints: q = sign * q of the left arm in the mirrored posture.
    pub signs: [ArmQ; ARMS],
    /// Joints 6 and 7 of the left and the right arm.
    pub wrists: [TwoAxes; ARMS],
    /// The joints that turn the head, if there are any.
    pub head: Option<TwoAxes>,
    /// The joint that lifts the torso, if there is one.
    pub lift: Option<Lift>,
    /// Its proportions.
    pub proportions: Proportions,
}

/// Constant configuration of the stage.
#[derive(Clone, Debug)]
pub struct Config {
    pub(crate) solver: PostureSolver,
    pub(crate) velocity_max: ArmQ,
    pub(crate) home: [f64; JOINTS_MAX],
    pub(crate) robot: RobotId,
    pub(crate) joints: [[usize; ARM_Q]; ARMS],
    pub(crate) signs: [ArmQ; ARMS],
    pub(crate) wrists: [TwoAxes; ARMS],
    pub(crate) head: Option<TwoAxes>,
    pub(crate) prediction: Option<Prediction>,
    pub(crate) delay_ns: u64,
    pub(crate) follows: [bool; ARMS],
    pub(crate) correction: Correction,
    pub(crate) lift: Option<Lift>,
}

impl Config {
    /// Checks the options. The weights were checked against the robot when they were read.
    pub fn for_arms(robot: &RobotArms, weights: Option<Weights>, options: &Options) -> Result<Self, ConfigError> {
        within("refine_steps", f64::from(options.refine_steps), f64::from(REFINE_STEPS_MAX))?;
        within("following_delay_ms", options.following_delay_ms, DELAY_MAX_NS as f64 * 1e-6)?;
        within("contact_weight", options.contact_weight, 1.0)?;
        let network = match (options.method, weights) {
            (Some(Method::ClosedForm), _) | (None, None) => None,
            (Some(Method::Network), None) => return Err(ConfigError::NoWeights),
            (Some(Method::Network) | None, Some(weights)) => Some(weights.network),
        };
        Ok(Self {
            solver: PostureSolver { arm: robot.identity.arm.clone(), network, refine_steps: options.refine_steps },
            velocity_max: robot.velocity_max,
            home: robot.home,
            robot: robot.robot,
            joints: robot.joints,
            signs: robot.signs,
            wrists: robot.wrists,
            head: robot.head,
            prediction: None,
            delay_ns: (options.following_delay_ms * 1e6) as u64,
            follows: options.arms,
            lift: robot.lift.filter(|_| options.lift_follows),
            correction: Correction { robot: robot.proportions, weight: options.contact_weight },
        })
    }

    /// Sets the learnt prediction of the limbs. Without it a limb continues its last turn at a fading rate.
    #[must_use]
    pub fn with_prediction(self, prediction: Option<Prediction>) -> Self {
        Self { prediction, ..self }
    }

    /// The method in force.
    pub fn method(&self) -> Method {
        if self.solver.network.is_some() { Method::Network } else { Method::ClosedForm }
    }

    /// Model of the left arm. The right arm is its mirror.
    pub fn arm(&self) -> &ArmModel {
        &self.solver.arm
    }
}

fn within(key: &'static str, value: f64, max: f64) -> Result<(), ConfigError> {
    if (0.0..=max).contains(&value) { Ok(()) } else { Err(ConfigError::Range { key, value, min: 0.0, max }) }
}
