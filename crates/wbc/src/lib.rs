//! Whole-body control with a certified stop plan. Never performs IO, never reads a clock, and a tick never allocates,
//! locks, blocks or panics.
//!
//! Every tick proposes a new jerk for each joint. It accepts it only with a proof that covers the tick and
//! the stop after it. The proof shows that they keep all limits, and the clearance of the collision model, at
//! every instant. Otherwise the robot continues the plan that was proved before. At rest the plan is to stay.
//! So there is always a proved plan, and every command carries it.
//!
//! - [`plan`]: the stop of a joint in closed form, and how to play it.
//! - [`interval`]: the jerks that a joint may take.
//! - [`track`]: the jerk that it wants to take.
//! - `barrier`: changes the wanted jerks where a pair is near. [`qp`]: the quadratic program for this.
//! - `brake`: how hard an arm may brake where its motors have little to spare.
//! - `choose`: the decision, from the wanted jerk to the proof.
//! - `recover`: the way back from outside the limits, or from too little clearance.
//! - [`chain`], [`geometry`]: kinematics and the collision model for the proof.
//! - [`trajectory`]: the motion to be proved.
//! - [`torque`]: the proof that the motors can perform it, with its derivation. [`dynamics`]: the dynamics
//!   that it uses.
//! - [`certificate`]: the proof of clearance, with its derivation. [`interface`]: the distance that a robot's
//!   own controllers may take from it.
//!
//! Terms:
//!
//! - A *stop* brings a joint to rest.
//! - A *plan* is the stops of all joints, started together.
//! - A joint is *fresh* if it took a new decision in this tick.
//! - An *anchor* is the posture, with its distances, at which a proof starts.

#![forbid(clippy::disallowed_macros, clippy::disallowed_methods, clippy::disallowed_types)]
#![allow(clippy::needless_range_loop, reason = "a joint index runs over several arrays at once")]

mod barrier;
mod brake;
pub mod certificate;
pub mod chain;
mod choose;
mod clearance;
pub mod config;
pub mod dynamics;
pub mod geometry;
mod hand;
pub mod interface;
pub mod interval;
mod model;
mod nearest;
pub mod plan;
pub mod qp;
mod recover;
mod solid;
mod tick;
pub mod torque;
pub mod track;
pub mod trajectory;

pub use barrier::Program;
pub use config::{
    Config, ENGAGE_MARGIN_M, Options, PLANNED_BODY_SPEED_SHARE, PLANNED_SHARE, PLANNED_SPEED_SHARE,
    PLANNED_WRIST_SPEED_SHARE, Parts, Tasks, WbcError,
};
pub use interface::{Controllers, Interface, Interpolation};
pub use messages::{JointMotion, Permit};
pub use plan::{JointState, JointStop, PlannedMotion};
pub use tick::{
    Candidate, Input, Output, State, Target, certify_plan, certify_rest, certify_torque, overloaded_at_rest, tick,
    torques,
};
