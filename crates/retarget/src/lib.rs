//! Converts a person's limbs to joint positions through a shared latent space. Never does IO, never reads a clock,
//! and its tick never allocates, locks or panics.
//!
//! Glossary: a *limb* is an upper arm or a forearm. Its *rotation* is the difference from the T-pose in the torso
//! frame. *S_GR* is the metric of the paper: sum over limbs of 1 - <q_h, q_r>^2. A right arm is mirrored to a left
//! arm at the input. Its joint values need no mirroring back.

#![forbid(clippy::disallowed_macros, clippy::disallowed_methods, clippy::disallowed_types)]

mod arm;
mod closed_form;
mod config;
pub mod contact;
mod extrapolation;
mod height;
mod kinematic_chain;
mod limb_trajectory;
mod model;
mod network;
mod oracle;
mod pointing;
pub mod policy;
mod posture;
mod prediction;
mod ready;
mod refine;
mod resample;
mod smoothstep;
pub mod surface;
mod tick;
mod weights;

pub use arm::{ARM_Q, ARMS, ArmModel, ArmQ, FEATURES, Linearization, RESIDUALS, features, limb_error_deg, s_gr};
pub use closed_form::{branch as closed_form_branch, closed_form};
pub use config::{Config, ConfigError, FollowingArms, Method, REFINEMENT_STEPS_MAX, RobotArms, Settings};
pub use extrapolation::Extrapolation;
pub use height::{Lift, crouch_m};
pub use kinematic_chain::KinematicChain;
pub use network::{HIDDEN_MAX, LATENT, Latent, Layers, Network, OVERREACH, interpolate_latent};
pub use oracle::oracle;
pub use perceptron::{Dense, HEADER_MAX_BYTES, WeightsError, WriteError, sha256_hex};
pub use posture::{PostureSolver, SolvedPose, posture, solve_poses};
pub use prediction::{
    AGES_S, HORIZONS_S, History, PREDICTION_FORMAT, PREDICTION_INPUTS, PREDICTION_OUTPUTS, PREDICTION_WIDTHS,
    Prediction, PredictionManifest, Turns, prediction_inputs, turn, turns_at,
};
pub use refine::{PRIOR_WEIGHT, Refined, STEP_MAX_RAD, refine};
pub use resample::{DELAY_MAX_NS, Placed, STALE_NS, Sample, SourceClock, Track};
pub use robot::Limbs;
pub use robot::limbs::{mirror, rotation_from_xyzw, slerp, xyzw_from_rotation};
pub use tick::{Counters, Input, Output, State, tick};
pub use weights::{ArmIdentity, FORMAT, Manifest, RIGHT_ARM, Weights, read_layers, write_weights};
