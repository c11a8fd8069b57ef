//! All integration tests of `wbc`. They are one program, so that it is linked once.

mod allocation;
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

#[global_allocator]
static ALLOCATOR: rt::CountingAllocator = rt::CountingAllocator;
