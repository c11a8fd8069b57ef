//! All integration tests of `robot` but those that count allocations: one program, so that it is linked once.

mod environment;
mod kinematics;
mod refusals;
mod segments;
mod shipped;
mod support;
