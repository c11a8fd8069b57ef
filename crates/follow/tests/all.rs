//! All integration tests of `follow` but the one that counts allocations: one program, so that it is linked once.

mod arm;
mod following;
mod hostile;
mod solver;
mod support;
mod wrist;
