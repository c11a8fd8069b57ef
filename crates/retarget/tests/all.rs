//! All integration tests of `retarget` but those that count allocations: one program, so that it is linked once.

mod kinematics;
mod network;
mod perceptron;
mod prediction;
mod rate;
mod resampling;
mod robot;
mod smoothness;
mod support;
mod way;
