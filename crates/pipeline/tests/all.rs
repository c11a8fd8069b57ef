//! All integration tests of `pipeline` but those that count allocations: one program, so that it is linked once.

mod engaging;
mod environment;
mod files;
mod input_faults;
mod layouts;
mod noise;
mod payload;
mod recovery;
mod reduced;
mod robot_faults;
mod robot_interface;
mod standstill;
mod support;
