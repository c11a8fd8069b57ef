//! All integration tests of `safety`, except those that count allocations. They are one program, so that it
//! is linked once.

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
