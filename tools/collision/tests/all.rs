//! All integration tests of `collision` but those that count allocations: one program, so that it is linked once.

mod command;
mod containment;
mod dynamics;
mod formats;
mod limits;
