//! The trainer of the shared latent space: data, networks, losses, optimiser, checkpoints and weights files.
//!
//! One arm is trained, unsupervised and unpaired; a mirrored right arm uses the same networks.

pub mod kinematics;
pub mod mlp;
pub mod networks;
pub mod objective;
pub mod optimiser;
pub mod sampling;
pub mod session;
pub mod wide;
