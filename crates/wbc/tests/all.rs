//! All integration tests of `wbc`, except those that count allocations. They are one program, so that it is
//! linked once.

mod attack;
mod curve;
mod hand;
mod interface;
mod interval;
mod plan;
mod qp;
mod recover;
mod rollout;
mod slide;
mod support;
mod swing;
mod torque;
