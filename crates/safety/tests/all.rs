//! All integration tests of `safety`. They are one program, so that it is linked once.

mod allocations;
mod clutch;
mod engage;
mod engage_mutants;
mod engage_priority;
mod engage_snapshot;
mod feedback;
mod gate;
mod gate_plan;
mod gate_state;
mod gate_way;
mod gripper;
mod movement;
mod recovery;
mod reduced;
mod support;
mod target;

#[global_allocator]
static ALLOCATOR: rt::CountingAllocator = rt::CountingAllocator;
