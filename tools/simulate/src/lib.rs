//! Deterministic simulation: all stages with their real ticks in virtual time, under faults that a seed decides, before an
//! oracle that knows nothing of their arithmetic.
//!
//! A run is a function of its seed, its schedule and its length. A schedule is a list of episodes, each a function of its
//! own parameter, so that one can be left out without changing the others: that is how a failing schedule is made small.

pub mod active;
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
pub mod processes;
pub mod report;
pub mod rules;
pub mod run;
pub mod schedule;
pub mod shrink;
pub mod subject;
pub mod tampered;
