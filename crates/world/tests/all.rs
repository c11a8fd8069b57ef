//! All integration tests of `world` except those that count allocations. They are one program, so they are
//! linked once.

mod engaging;
mod environment;
mod feedback;
mod files;
mod grippers;
mod input_faults;
mod layouts;
mod lift;
mod noise;
mod one_arm;
mod payload;
mod recovery;
mod reduced;
mod robot_faults;
mod robot_interface;
mod standstill;
mod support;
