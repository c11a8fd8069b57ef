//! All integration tests of `retarget` except those that count allocations. They are one program, so they are
//! linked once.

mod contact;
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
