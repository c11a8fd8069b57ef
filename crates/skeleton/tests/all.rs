//! All integration tests of `skeleton` but those that count allocations: one program, so that it is linked once.

mod content;
mod limbs;
mod order;
mod person;
mod reference;
mod tick;
