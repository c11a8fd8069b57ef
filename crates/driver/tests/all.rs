//! All integration tests of `driver`. They are one program, so they are linked once.

mod bench;
mod carried_on;
mod follower;
mod model;
mod suspension;
mod world;
