//! All integration tests of `torture` but those that count allocations: one program, so that it is linked once.

mod attack;
mod command;
mod meshes;
mod motions;
mod stop_times;
