//! The trainer of the shared latent space: data, networks, losses, optimiser and weights files. It
//! also trains the prediction of a person's motion (see [`prediction`]) and the lifter of a camera's points (see [`lifting`]).
//!
//! One arm is trained, unsupervised and unpaired. A mirrored right arm uses the same networks. Glossary: a
//! *pose* is the rotations of an arm's two limbs, and a *posture* its joint positions. A *shard* is one
//! thread's half of a batch. *K* is the number of refinement steps after the network.

#![allow(missing_docs, reason = "the library of a program: only the program, tests and other tools use it")]

pub mod cli;
pub mod clips;
pub mod evaluation;
pub mod files;
pub mod fit;
pub mod gemm;
pub mod gimbal;
pub mod kinematics;
pub mod lifting;
pub mod mlp;
pub mod networks;
pub mod objective;
pub mod optimiser;
pub mod prediction;
pub mod run;
pub mod sampling;
pub mod session;
pub mod start;
