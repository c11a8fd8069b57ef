//! All integration tests of `robot`. They are one program, so they are linked once.

mod convert;
mod draft;
mod environment;
mod kinematics;
mod others;
mod pointing;
mod refusals;
mod segments;
mod shipped;
mod support;
