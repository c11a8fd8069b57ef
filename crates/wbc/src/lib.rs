//! Whole-body control with a certified stop plan. Never performs IO, never reads a clock, and a tick never allocates,
//! locks, blocks or panics.
//!
//! Every tick proposes a new jerk for each joint and accepts it only if the tick and the stop after it are proved to
//! keep all limits and the clearance of the collision model at every instant. Otherwise the robot continues the plan
//! that was proved before. At rest the plan is to stay, so there is always a proved plan, and it travels with every
//! command.
//!
//! - [`plan`]: the stop of a joint in closed form, and playing it.
//! - [`interval`]: the jerks a joint may take.
//! - [`track`]: the jerk it would like to take.
//! - `barrier`: what it would like instead where a pair is near; [`qp`]: the program that this takes.
//! - `brake`: how hard an arm may brake where its motors have little to spare.
//! - `choose`: the decision, from wish to proof.
//! - `recover`: the way back from outside the limits, or from too close.
//! - [`chain`], [`geometry`]: kinematics and the collision model as the proof needs them.
//! - [`motion`]: the motion that is to be proved.
//! - [`torque`]: the proof that the motors can give it, with its derivation; [`dynamics`]: what it computes with.
//! - [`certificate`]: the proof of clearance, with its derivation; [`interface`]: what a robot's own controllers take from it.
//!
//! Words: a *stop* brings a joint to rest; a *plan* is the stops of all joints, started together; *fresh* is a joint
//! that took a new decision in this tick; an *anchor* is the posture with the distances that a proof starts from.

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
pub mod motion;
mod nearest;
pub mod plan;
pub mod qp;
mod recover;
mod solid;
mod tick;
pub mod torque;
pub mod track;

pub use barrier::Program;
pub use config::{
    Config, ENGAGE_MARGIN_M, Options, PLANNED_SHARE, PLANNED_SPEED_SHARE, PLANNED_WRIST_SPEED_SHARE, Parts, Tasks,
    WbcError,
};
pub use interface::{Interface, Interpolation};
pub use plan::{JointState, JointStop, Planned};
pub use tick::{
    Candidate, Input, Output, Permit, State, Target, certify_plan, certify_rest, certify_torque, overloaded_at_rest,
    tick, torques,
};
