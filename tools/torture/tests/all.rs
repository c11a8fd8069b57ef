//! All integration tests of `torture` except those that count allocations. They are one program, so that it is
//! linked once.

mod attack;
mod command;
mod meshes;
mod motions;
mod stop_times;
