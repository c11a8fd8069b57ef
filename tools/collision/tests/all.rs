//! All integration tests of `collision` except those that count allocations. They are one program, so that it
//! is linked once.

mod command;
mod containment;
mod cover;
mod first;
mod formats;
mod limits;
