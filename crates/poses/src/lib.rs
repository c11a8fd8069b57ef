//! Named key poses, the motions between them with the robot's best joint trajectories, and mixtures of poses in the
//! latent space. All poses are our own. Also the postures of whole motions, frame by frame.

pub mod error;
pub mod keys;
pub mod motions;
pub mod person;
pub mod pose;
pub mod postures;
pub mod retargeted;
pub mod trajectory;
pub mod triangle;
