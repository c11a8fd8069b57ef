//! Deterministic simulation: all stages run their real ticks in virtual time, under faults that a seed decides.
//! The oracle that judges them knows nothing of their arithmetic.
//!
//! A run is a function of its seed, its schedule and its length. A schedule is a list of episodes, each a function of
//! its own parameter. So an episode can be left out without changing the others, and a failing schedule can be shrunk.

#![allow(missing_docs, reason = "only the program and its tests use the library")]

pub mod active;
pub mod camera;
pub mod campaign;
pub mod cli;
pub mod client;
pub mod feedback;
pub mod frames;
pub mod inputs;
pub mod kinds;
pub mod modes;
pub mod movement;
pub mod operator_model;
pub mod oracle;
pub mod person_judge;
mod policy;
pub mod processes;
mod remote;
pub mod report;
pub mod rules;
pub mod run;
pub mod schedule;
pub mod shrink;
pub mod subject;
pub mod tampered;
pub mod true_motion;
