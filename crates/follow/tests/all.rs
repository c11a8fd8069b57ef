//! All integration tests of `follow` except the one that counts allocations. They are one program, so they are
//! linked once.

mod arm;
mod following;
mod gap;
mod hostile;
mod solver;
mod support;
mod wrist;
