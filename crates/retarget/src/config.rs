//! Configuration of the stage: the robot's arms, and the settings of the user.

use messages::{JOINTS_MAX, RobotId};
use robot::PointingJoints;
use serde::{Deserialize, Serialize};

use crate::arm::{ARM_Q, ARMS, ArmModel, ArmQ};
use crate::contact::{Correction, Proportions};
use crate::height::Lift;
use crate::posture::PostureSolver;
use crate::prediction::Prediction;
use crate::resample::DELAY_MAX_NS;
use crate::weights::Weights;

/// Largest number of refinement steps in a tick, at about 0.3 us each (measured 2026-11-21). From the third step on, a step
/// gains less than 0.02 degrees (`eval`).
pub const REFINEMENT_STEPS_MAX: u32 = 10;
/// Longest following delay, ms.
const DELAY_MAX_MS: f64 = DELAY_MAX_NS as f64 * 1e-6;

/// How a skeleton becomes joint positions.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Serialize, Eq)]
#[serde(rename_all = "kebab-case")]
pub enum Method {
    /// The shared latent space.
    Network,
    /// The geometric baseline.
    ClosedForm,
}

/// Arms of the robot that follow the person.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Serialize, Eq)]
#[serde(rename_all = "kebab-case")]
pub enum FollowingArms {
    /// Both arms.
    Both,
    /// The left arm alone.
    Left,
    /// The right arm alone.
    Right,
}

impl FollowingArms {
    /// Returns true for the left and the right arm if it follows.
    pub fn sides(self) -> [bool; ARMS] {
        [self != Self::Right, self != Self::Left]
    }
}

schema::table! {
    /// How skeletons become joint positions.
    pub struct Settings {
        /// Method that turns a skeleton into joint positions. `"network"` is the trained latent space, `"closed-form"` the
        /// geometric baseline.
        method: Method = Method::Network;
        /// Levenberg-Marquardt steps after the network.
        refinement_steps: u32 = 2, in [0.0, REFINEMENT_STEPS_MAX as f64];
        /// Time from the capture of a person to the command that stands for it, ms. A longer delay brings the
        /// robot nearer to the person's motion.
        following_delay_ms: f64 = 120.0, in [0.0, DELAY_MAX_MS];
        /// The same delay where one camera without depth sees the person. What it guesses trembles, so more of it is
        /// waited for.
        camera_following_delay_ms: f64 = 180.0, in [0.0, DELAY_MAX_MS];
        /// Arms of the robot that follow, with their hands: `"both"`, `"left"` or `"right"`. The other arm keeps its home
        /// posture.
        arms: FollowingArms = FollowingArms::Both;
        /// The lift follows the person's height, slowly: it goes down as the person crouches. A robot without a lift keeps its
        /// torso, and so does one whose person's legs are not seen.
        lift_follows: bool = false;
        /// How much the arms give up of the person's limbs so that hands meet head, chest and each other where the person's
        /// do. With `0.0`, limbs alone are followed.
        contact_weight: f64 = 0.0, in [0.0, 1.0];
        /// Network that predicts how a person goes on, as a path without extension, relative to the settings file. It names
        /// `FILE.safetensors` and `FILE.toml`. With `""` there is none, and the turn of each limb fades.
        prediction: String = "../weights/prediction".to_owned();
    }
}

impl Settings {
    /// Delays behind a person who is measured, and behind one whom one camera sees, ms.
    pub fn following_delays_ms(&self) -> [f64; 2] {
        [self.following_delay_ms, self.camera_following_delay_ms]
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
    #[error(transparent)]
    OutOfRange(#[from] schema::OutOfBounds),
}

/// Data of the robot that a tick needs.
#[derive(Clone, Debug)]
pub struct RobotArms {
    /// Both arms as left arms. They are equal if they mirror each other.
    pub arms: [ArmModel; ARMS],
    /// Velocity limits of the joints that turn the limbs, rad/s.
    pub velocity_max: [ArmQ; ARMS],
    /// Home posture of all joints. The target shows it for a joint that is not valid.
    pub home: [f64; JOINTS_MAX],
    /// Number and order of the robot's joints.
    pub robot: RobotId,
    /// Indices of the joints that turn the limbs of the left and the right arm, by slot.
    pub joints: [[Option<usize>; ARM_Q]; ARMS],
    /// Signs of these joints: q = sign * q of the left arm in the mirrored posture.
    pub signs: [ArmQ; ARMS],
    /// The joints that turn the left and the right hand.
    pub wrists: [PointingJoints; ARMS],
    /// The joints that turn the head, if there are any.
    pub head: Option<PointingJoints>,
    /// The joint that lifts the torso, if there is one.
    pub lift: Option<Lift>,
    /// Its proportions as each arm sees them.
    pub proportions: [Proportions; ARMS],
}

/// Constant configuration of the stage.
#[derive(Clone, Debug)]
pub struct Config {
    pub(crate) solver: PostureSolver,
    pub(crate) velocity_max: [ArmQ; ARMS],
    pub(crate) home: [f64; JOINTS_MAX],
    pub(crate) robot: RobotId,
    pub(crate) joints: [[Option<usize>; ARM_Q]; ARMS],
    pub(crate) signs: [ArmQ; ARMS],
    pub(crate) wrists: [PointingJoints; ARMS],
    pub(crate) head: Option<PointingJoints>,
    pub(crate) prediction: Option<Prediction>,
    /// [`Settings::following_delays_ms`] in ns.
    pub(crate) delays_ns: [u64; 2],
    pub(crate) follows: [bool; ARMS],
    pub(crate) correction: Correction,
    pub(crate) lift: Option<Lift>,
}

impl Config {
    /// Checks the settings. The weights were checked against the robot when they were read.
    ///
    /// # Errors
    /// Returns an error for a value outside its bounds, and for the network without weights.
    pub fn for_arms(robot: &RobotArms, weights: Option<Weights>, settings: &Settings) -> Result<Self, ConfigError> {
        settings.check()?;
        let network = match (settings.method, weights) {
            (Method::ClosedForm, _) => None,
            (Method::Network, None) => return Err(ConfigError::NoWeights),
            (Method::Network, Some(weights)) => Some(weights.network),
        };
        Ok(Self {
            solver: PostureSolver { arms: robot.arms.clone(), network, refine_steps: settings.refinement_steps },
            velocity_max: robot.velocity_max,
            home: robot.home,
            robot: robot.robot,
            joints: robot.joints,
            signs: robot.signs,
            wrists: robot.wrists,
            head: robot.head,
            prediction: None,
            delays_ns: settings.following_delays_ms().map(|ms| (ms * 1e6) as u64),
            follows: settings.arms.sides(),
            lift: robot.lift.filter(|_| settings.lift_follows),
            correction: Correction { robot: robot.proportions, weight: settings.contact_weight },
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

    /// Models of both arms, as left arms.
    pub fn arms(&self) -> &[ArmModel; ARMS] {
        &self.solver.arms
    }
}
