//! All integration tests of `skeleton` except those that count allocations. They are one program, so they are
//! linked once.

mod content;
mod limbs;
mod order;
mod person;
mod reference;
mod tick;
