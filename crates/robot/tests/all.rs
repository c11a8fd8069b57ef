//! All integration tests of `robot`, except those that count allocations. They are one program, so that it is
//! linked once.

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
