//! Compares retargeting methods on recorded motion: error, smoothness, time. Also measures how closely the
//! robot then follows ([`following`]).
//!
//! Glossary: a *limb* is an upper arm or a forearm. A *pose* is the limbs of both arms of a human, and a
//! *posture* the joint positions of both arms of the robot. *K* is the number of refinement steps after the
//! network. The *oracle* is S_GR minimised from many starts. [`metrics`] defines each column.

#![allow(missing_docs, reason = "the library of a program: only the program, tests and other tools use it")]

pub mod cli;
pub mod clips;
pub mod following;
pub mod methods;
pub mod metrics;
pub mod plots;
pub mod refusals;
pub mod report;
pub mod run;
pub mod timing;
pub mod video;
pub mod words;
